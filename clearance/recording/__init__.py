"""Recordings: what an instrument sees of the mechanism, with one type for simulated and measured signals."""
