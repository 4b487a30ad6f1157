"""Unknown forces beside a path that is near: what a machine lacks shows in them."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.following.attempt import loosen
from clearance.diagnosis.hypotheses.free_form import curve_over, free_form
from tests.diagnosis.shooting.test_follow import MACHINE, MODEL, TRUTH, follower

LARGE = np.array([0.7, 0.17, 2.9])  # N m, N m, N: what is looked for beside any path
INNER = slice(8, -8)


@pytest.mark.parametrize("push", [0.0, 2.0])
def test_unknown_forces_are_those_that_a_machine_lacks(push):
    """They are found on the slider, where they act, and lie in the band of what is known of them."""
    curve = curve_over(np.linspace(0.05, 0.2, 50), "slider", "x", "slider_position")
    forces = np.full(len(curve.knots), push)
    pushed = free_form(replace(curve, forces=forces), "C").apply(MACHINE, forces)
    free = loosen(MODEL, TRUTH, [follower(machine=pushed)], [LARGE], (3.16, 1.0))
    found, random = free.followers[0].path.inputs, np.random.default_rng(0)
    assert found.any()
    drawn = np.array([free.fit.passes[0].draw(random)[:, -len(LARGE) :] for _ in range(100)])
    deviation = drawn.std(axis=0) * LARGE
    for acting, expected in enumerate((0.0, 0.0, push)):
        off, band = np.abs(found[INNER, acting] - expected), 1.96 * deviation[INNER, acting]
        assert (off < band).mean() > 0.9
        assert np.median(band) < 0.35 * LARGE[acting]
