"""A recording of a simulated machine with friction on its guide, for those who have none yet."""

from dataclasses import replace

import numpy as np

from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.guide import StribeckGuide
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.recording import Recording
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import ACCELERATIONS, Signal
from clearance.simulation.trajectory import simulate_trajectory

CLEARANCE, FRICTION, SPEED = 0.3e-3, 5.0, 700.0  # m, N, rpm: what the diagnosis should find
_NOISE = 0.01  # of each channel's standard deviation
_SETTLED, _DURATION, _MARGIN = 0.5, 0.6, 0.01  # s


def demonstration(machine: SliderCrank) -> dict[str, Recording]:
    """One recording of a machine by name, made with steps five times shorter than those of the diagnosis.

    Args:
        machine: with clearance, and nothing missing.
    """
    friction = StribeckGuide(
        coulomb_force=FRICTION, viscous_damping=0.0, stribeck_force=0.0, friction_coefficient=0.0
    )
    made = replace(machine, guide_friction=friction, drive=SpeedControl(SPEED, ramp=0.1))
    return {"demonstration": record(made, 1)}


def record(machine: SliderCrank, seed: int) -> Recording:
    """All accelerations of a machine that runs in, with noise."""
    chain = MeasurementChain()
    duration = _SETTLED + _DURATION + _MARGIN
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", 2e-6, 5), duration, 5)
    first = round((_SETTLED - _MARGIN) * chain.base_rate)
    values = chain.apply(run.signals[first:, :ACCELERATIONS])[round(_MARGIN * chain.rate) :]
    values = values[: round(_DURATION * chain.rate)]
    moving = values.std(axis=0) > 1e-9
    values = values[:, moving]
    noise = np.random.default_rng(seed).normal(size=values.shape)
    channels = tuple(Signal(int(i)).name.lower() for i in np.flatnonzero(moving))
    return Recording(values + _NOISE * values.std(axis=0) * noise, channels, chain.rate)
