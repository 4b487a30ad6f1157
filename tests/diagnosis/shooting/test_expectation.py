"""Fitting: angles have no bounds, and are never far from where they are expected."""

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import of_effect
from clearance.diagnosis.shooting.expectation import Expectation, wrapped
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.mechanism.slider_crank import SliderCrank


def test_an_angle_is_as_far_from_home_as_the_shorter_way_round():
    unknowns = (Unknown("size", 1e-3, reach=0.3), Unknown("phase", 1e-3, -6.3, 6.3, reach=0.3, turns=True))
    model = Model((*unknowns, Unknown("speed", 1e-3, own=True)), lambda values: SliderCrank())
    home = np.array([[1.0, np.pi, 70.0]])
    expected = Expectation(model, home, home)
    assert expected.distance(np.array([[9.0, -np.pi + 0.1, 70.0]])) == pytest.approx([8.0, 0.1, 0.0])
    assert expected.cost(np.array([[1.0, -np.pi, 70.0]])) == pytest.approx(0.0, abs=1e-20)
    np.testing.assert_allclose(
        wrapped(np.array([3.2, -3.2, 0.5, 7.0])), [3.2 - 2 * np.pi, 2 * np.pi - 3.2, 0.5, 7.0 - 2 * np.pi]
    )


@pytest.mark.parametrize(("name", "turning"), [("worn_bearing", ["phase"]), ("guide_friction", [])])
def test_phases_turn_and_nothing_else_does(name, turning):
    effect = load_effects([name])[0]
    found = of_effect(effect, SliderCrank(), "C")[0]
    assert [unknown.name for unknown in found.unknowns if unknown.turns] == turning
