"""Motion without forces: what accelerations show of the path, and what the path needs."""
