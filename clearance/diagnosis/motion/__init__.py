"""Diagnosis of recordings that show only how the crank turns and the slider moves: no accelerometers."""
