"""Read the clearance of a slider-crank's joints from accelerations, and find what a simulator lacks."""

__version__ = "0.1.0"
