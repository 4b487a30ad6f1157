"""How the machine moves: equations of motion, schemes that integrate them, many runs in lockstep."""
