"""A force that repeats on a known frame, read off the crank's end."""

import numpy as np
import pytest

from clearance.diagnosis.kinematics.pushing import find_pushing
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.guide import StribeckGuide
from tests.diagnosis.kinematics.test_reconstruction import machine, recorded
from tests.diagnosis.kinematics.test_swaying import SOFT, turning

WAVE = np.repeat([40.0, -40.0], 6)


def found_of(*machines, **known):
    """What is found in recordings of some machines, whose frame is known."""
    parts = [recorded(made) for made in machines]
    turns = [turning(states) for _, states in parts]
    return find_pushing([measured for measured, _ in parts], turns, machine("C", 1e-4, **known))


@pytest.mark.parametrize("direction", ["x", "y"])
def test_period_course_and_direction_of_a_force_on_a_known_frame(direction):
    force = TabulatedForce("frame", direction, "time", 0.0, None, tuple(WAVE), "linear", 0.06)
    later = TabulatedForce("frame", direction, "time", 0.0, None, tuple(np.roll(WAVE, 3)), "linear", 0.06)
    found = found_of(*(machine("C", 3e-4, frame=SOFT, force=one) for one in (force, later)), frame=SOFT)
    assert found.direction == direction
    assert found.share > 0.95
    assert type(found.rhythm.period) is float  # it is written to a file
    assert found.rhythm.period == pytest.approx(0.06, rel=5e-3)
    assert np.ptp(found.forces) == pytest.approx(80.0, rel=0.05)  # twelve harmonics overshoot
    apart = (found.rhythm.clocks[1] - found.rhythm.clocks[0]) % 0.06
    assert apart == pytest.approx(0.045, abs=2e-3)  # the other one's force comes a quarter later


@pytest.mark.parametrize("laws", [{}, {"guide_friction": StribeckGuide(coulomb_force=10.0)}])
def test_nothing_pushes_a_frame_that_only_the_links_shake(laws):
    assert found_of(machine("C", 3e-4, frame=SOFT, **laws), frame=SOFT) is None


def test_a_frame_that_is_not_known_to_give_way_is_not_asked():
    assert found_of(machine("C", 3e-4, frame=SOFT)) is None


def test_what_changes_within_a_segment_is_not_told_too_small():
    """The third harmonic of 50 Hz: means over a millisecond leave 96 % of it."""
    wave = 30.0 * np.cos(2.0 * np.pi * np.arange(24) / 24) + 20.0 * np.cos(6.0 * np.pi * np.arange(24) / 24)
    force = TabulatedForce("frame", "x", "time", 0.0, None, tuple(wave), "cubic", 0.02)
    found = found_of(machine("C", 3e-4, frame=SOFT, force=force), frame=SOFT)
    amplitudes = 2.0 / len(found.forces) * np.abs(np.fft.rfft(found.forces))
    np.testing.assert_allclose(amplitudes[[1, 3]], [30.0, 20.0], rtol=0.015)
