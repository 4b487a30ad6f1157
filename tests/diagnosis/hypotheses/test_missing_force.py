"""Which curve of free form explains unknown forces, and with how many knots."""

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import KNOTS, along, arguments_of
from clearance.diagnosis.hypotheses.missing_force import Seen, curves, directions

SEGMENTS = 1200


@pytest.mark.parametrize(("order", "fewest"), [(2, KNOTS), (8, 2 * KNOTS)])
def test_a_torque_on_the_crank_has_as_many_knots_as_its_harmonic_takes(order, fewest):
    random = np.random.default_rng(order)
    angle = (0.09 * np.arange(SEGMENTS)) % (2.0 * np.pi)
    torque = np.cos(order * angle + 0.4)
    places = directions("B")
    pattern = np.zeros((SEGMENTS, 3, 2 * len(places)))
    pattern[:, 0, places.index(("crank", "torque"))] = 8.0  # a torque of one, in units of its scatter
    pattern[:, 1:, 1:] = random.normal(size=(SEGMENTS, 2, pattern.shape[2] - 1))
    forces = random.normal(size=(SEGMENTS, 3))
    forces[:, 0] += 8.0 * torque
    arguments = dict.fromkeys(arguments_of("rod"), np.linspace(0.0, 1.0, SEGMENTS))
    seen = Seen(forces, np.ones(3), arguments | {"crank_angle": angle})
    best = curves(seen, pattern, "B", np.ones(2 * len(places)))[0]
    assert (best.body, best.argument, len(best.knots)) == ("crank", "crank_angle", fewest)
    assert np.corrcoef(along(best, angle), torque)[0, 1] > 0.95
