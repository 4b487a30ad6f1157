"""The proof of the diagnosis: machines whose truth is known to the one who scores, and to nobody else."""
