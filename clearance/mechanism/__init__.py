"""What the machine is: bodies, joints and the laws of its forces. No time passes here.

Each family of laws has one file: frozen dataclasses that hold a law's numbers in SI units, say where it comes
from and where it is valid, and the compiled function that computes its force. The null member of a family
switches the effect off.
"""
