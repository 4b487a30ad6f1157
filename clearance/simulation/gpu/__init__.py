"""The simulation on a GPU: the same laws and the same step, compiled for CUDA, one run a thread."""
