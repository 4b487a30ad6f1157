"""A frame that gives way where no sensor is at A: that it does, on what it stands, and how it moves."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.kinematics.agreement import profile
from clearance.diagnosis.kinematics.swaying import find_frame, sway, sways, told
from clearance.mechanism.applied_force import NoForce, TabulatedForce
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.guide import StribeckGuide
from clearance.simulation.layout import State
from tests.diagnosis.kinematics.test_reconstruction import (
    CHAIN,
    RPM,
    SECONDS,
    SENSORS,
    SETTLED,
    aligned,
    machine,
    recorded,
    run,
)

WAVE = tuple(1500.0 * np.sin(2.0 * np.pi * np.arange(12) / 12))
SOFT = FlexibleFrame(25.0, 0.03, 15.0)


def turning(states):
    known = aligned(states)
    return known.angle, known.speed


@pytest.mark.parametrize(
    "laws",
    [
        {"gravity": (0.0, -9.81)},
        {"guide_friction": StribeckGuide(coulomb_force=5.0)},
    ],
)
def test_a_frame_that_stands_fast_is_not_said_to_sway(laws):
    measured, states = recorded(machine("C", 3e-4, **laws))
    assert not sways(measured, *turning(states), machine("C", 1e-4).parameters())


@pytest.mark.parametrize("frame", [{}, {"frame": SOFT}])
def test_a_crank_may_turn_the_other_way(frame):
    measured, states = recorded(replace(machine("C", 4e-4, **frame), drive=SpeedControl(-RPM, ramp=0.05)))
    known = machine("C", 1e-4)
    assert turning(states)[1] < 0.0
    assert sways(measured, *turning(states), known.parameters()) == bool(frame)
    if frame:
        found = find_frame([measured], [turning(states)], known)
        assert found[[0, 2]] == pytest.approx([SOFT.frequency, SOFT.mass], rel=0.05)


@pytest.mark.parametrize(
    ("joint", "laws"), [("B", {"guide_friction": StribeckGuide(coulomb_force=10.0)}), ("C", {})]
)
def test_frequency_damping_and_mass_are_found_whatever_else_is_missing(joint, laws):
    measured, states = recorded(machine(joint, 4e-4, frame=SOFT, **laws))
    known = machine(joint, 1e-4)
    assert sways(measured, *turning(states), known.parameters())
    found = find_frame([measured], [turning(states)], known)
    assert found[0] == pytest.approx(SOFT.frequency, rel=0.03)
    assert found[1] == pytest.approx(SOFT.damping_ratio, abs=0.01)
    assert found[2] == pytest.approx(SOFT.mass, rel=0.05)


def test_a_sensor_with_another_gain_is_no_frame():
    measured, states = recorded(machine("C", 4e-4))
    measured.values[..., measured.channels.index("crank_b_transverse")] *= 1.3
    known = machine("C", 1e-4)
    assert sways(measured, *turning(states), known.parameters())
    assert find_frame([measured], [turning(states)], known) is None


@pytest.mark.parametrize(
    "force", [NoForce(), TabulatedForce("frame", "y", "time", 0.0, None, WAVE, "cubic", 0.06)]
)
def test_the_motion_of_a_known_frame(force):
    made = machine("C", 4e-4, frame=SOFT, force=force)
    measured, states = recorded(made)
    measured = replace(measured, clock=SETTLED)
    first, last = (round(time * CHAIN.base_rate) for time in (SETTLED, SETTLED + SECONDS))
    rates = run(made).states[:, [State.FRAME_X_RATE, State.FRAME_Y_RATE]]
    true = np.gradient(rates, 1.0 / CHAIN.base_rate, axis=0) @ np.array([1.0, 1j])
    smooth = np.stack([CHAIN.smooth(part[:, None])[:, 0] for part in (true.real, true.imag)], axis=1)
    wanted = (smooth @ np.array([1.0, 1j]))[first : last : CHAIN.decimation]
    found = sway(measured, *turning(states), made.parameters())
    assert np.std(found - wanted) < 0.05 * np.std(wanted)
    if force != NoForce():
        assert sway(measured, *turning(states), machine("C", 4e-4, frame=SOFT).parameters()) is None


def test_a_clearance_shows_against_a_frame_that_sways():
    measured, states = recorded(machine("C", 2e-4, frame=SOFT))
    found = [
        profile([measured], [aligned(states)], lambda c, frame=frame: machine("C", c, **frame), 1)
        for frame in ({}, {"frame": SOFT})
    ]
    assert found[1].misfit.min() < 0.5 * found[0].misfit.min()
    assert found[1].best == pytest.approx(2e-4, rel=0.05)


def test_a_recording_that_ends_before_the_filter_settles_does_not_tell():
    measured, states = recorded(machine("C", 4e-4, frame=SOFT))
    short = measured.part(0, 40)
    assert not told(short)
    assert not sways(short, *turning(states), machine("C", 1e-4).parameters())


def test_the_rods_sensors_alone_do_not_tell():
    measured, states = recorded(machine("C", 4e-4, frame=SOFT), sensors=SENSORS[2:6])
    assert not told(measured)
    assert not sways(measured, *turning(states), machine("C", 1e-4).parameters())
