"""When a force sets in: against the closed form, and as steps that end there."""

import numpy as np
import pytest

from clearance.mechanism.guide import LooseGuide, until_shoe_strikes
from clearance.mechanism.jump import until_reached
from clearance.mechanism.load import ConstantProcess, until_process_changes
from clearance.mechanism.slider_crank import SliderCrank

MOST = 1e-5


@pytest.mark.parametrize(
    ("distance", "rate", "acceleration"),
    [(1e-6, 0.5, 0.0), (1e-6, 0.5, 2e3), (4e-8, -1e-3, 4e3), (1e-6, 0.2, -5e3)],
)
def test_a_distance_is_covered_when_it_is_said_to_be(distance, rate, acceleration):
    time = until_reached(distance, 1e-9, rate, acceleration, MOST)
    assert 0.0 < time < MOST
    assert rate * time + 0.5 * acceleration * time**2 == pytest.approx(distance + 1e-9, rel=1e-9)


@pytest.mark.parametrize(
    ("distance", "rate", "acceleration"),
    [(1e-3, 0.5, 0.0), (-1e-9, 0.5, 0.0), (1e-6, -0.5, 0.0), (1e-6, 0.1, -1e4), (1e-6, 0.0, 0.0)],
)
def test_what_is_far_passed_or_never_reached_takes_the_longest_time(distance, rate, acceleration):
    assert until_reached(distance, 1e-9, rate, acceleration, MOST) == MOST


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_shoe_strikes_the_rail_it_moves_towards(side):
    p = SliderCrank(guide=LooseGuide(gap=2e-5)).parameters()
    time = until_shoe_strikes(p, side * 1.9e-5, side * 0.2, 0.0, MOST)
    assert time == pytest.approx(1e-6 / 0.2, rel=0.02)
    assert until_shoe_strikes(p, side * 1.9e-5, -side * 0.2, 0.0, MOST) == MOST


@pytest.mark.parametrize(
    ("position", "velocity"), [(0.1 - 4e-6, 1.0), (0.1 + 4e-6, -1.0), (0.14 - 4e-6, 1.0)]
)
def test_a_process_changes_at_both_edges_from_both_sides(position, velocity):
    p = SliderCrank(process=ConstantProcess(20.0, 0.10, 0.14)).parameters()
    time = until_process_changes(p, position, velocity, 0.0, MOST)
    assert time == pytest.approx(4e-6, rel=0.01)
    assert until_process_changes(p, position + np.sign(velocity) * 5e-6, velocity, 0.0, MOST) == MOST
