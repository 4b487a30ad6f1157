"""An independent simulator of the mechanism: it shares physics with the engine, but no code.

``Plant(joint="C", clearance=3e-4, effects={"guide_friction": {"coulomb_force": 5.0}}).recording(1.0)`` is a
table of signals that the diagnosis has to explain. The plant imports nothing of the engine, and the diagnosis
must import nothing of the plant.
"""

from clearance.trial.plant.extra import ExtraForce
from clearance.trial.plant.files import write_parquet
from clearance.trial.plant.machine import BASE_RATE, FloatArray, Instant, Plant, Run
from clearance.trial.plant.measurement import ACCELERATIONS, CHANNELS, MARGIN, Fault, measure

__all__ = [
    "ACCELERATIONS",
    "BASE_RATE",
    "CHANNELS",
    "MARGIN",
    "ExtraForce",
    "Fault",
    "FloatArray",
    "Instant",
    "Plant",
    "Run",
    "measure",
    "write_parquet",
]
