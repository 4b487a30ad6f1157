"""How the machine moves: the equations of motion, the schemes that integrate them, and many runs in lockstep."""
