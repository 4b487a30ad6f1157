"""The derivatives of one path serve beside another near by."""

import numpy as np
import pytest

from clearance.diagnosis.shooting.covariance import deviations
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.looks import compare, observe, same_coordinates, solve
from clearance.diagnosis.shooting.nearby import settle_nearby
from clearance.diagnosis.shooting.settle import settle, unsteady
from tests.diagnosis.shooting.test_follow import MODEL, TRUTH, follower

NOTHING = np.zeros(2)


@pytest.fixture(scope="module")
def rest():
    """A follower where a fit rests, and the fit."""
    one = follower()
    return one, fit([one], MODEL, TRUTH, 20, 1e-9, 1)


def linearised(one, values):
    passes = observe([one], MODEL, values, 1, forces=False)
    solve(passes, [unsteady(len(passes[0].local))], 1, judged=False)
    return passes


def test_a_chord_leads_back_as_new_derivatives_do(rest):
    one, found = rest
    own = one.part(0, one.segments)
    before = linearised(own, found.values)[0]
    aside = np.zeros((own.segments, len(before.chart.rows)))
    aside[20] = 1e-2 * before.reach
    own.move(aside, before.chart)
    seen = compare([own], MODEL, found.values, 1)[0]
    assert seen.cost > 3.0 * found.cost
    ends = []
    for step in (own.beside(before, seen), linearised(own, found.values)[0]):
        solve([step], [unsteady(len(seen.local))], 1, judged=False)
        away = own.part(0, own.segments)
        away.move(step.change(NOTHING), step.chart)
        ends.append(compare([away], MODEL, found.values, 1)[0].cost)
    chord, new = ends
    assert chord < found.cost + 20.0
    assert abs(chord - new) < 10.0


def test_beside_its_own_motion_a_linearisation_is_itself(rest):
    one, found = rest
    before = linearised(one, found.values)[0]
    seen = compare([one], MODEL, found.values, 1)[0]
    for new, old in zip(one.beside(before, seen).system, before.system, strict=True):
        np.testing.assert_allclose(new, old, rtol=1e-12, atol=1e-12)


def test_a_parameter_that_is_held_aside_costs_as_much_as_a_fit_beside_it_does(rest):
    one, found = rest
    passes = linearised(one, found.values)
    begin = found.values + np.array([5.0 * deviations(found)[0], 0.0])
    near, full = one.part(0, one.segments), one.part(0, one.segments)
    reached = settle_nearby([near], found, passes, begin, 0, 1)
    assert reached.values[0, 0] == begin[0, 0]
    fitted = settle([full], MODEL.only([1], begin[0]), begin[:, [1]], 10, 1e-9, 1)
    assert 0.5 * 25.0 < reached.cost - found.cost < 2.0 * 25.0
    assert reached.cost < fitted.cost + 5.0


def test_derivatives_do_not_serve_a_machine_with_other_coordinates(rest):
    one, found = rest
    passes = linearised(one, found.values)
    own = one.part(0, one.segments)
    ideal = compare([own], MODEL.held(np.array([0.0, found.values[0, 1]])), np.zeros((1, 0)), 1)
    assert not same_coordinates(passes, ideal)
    assert same_coordinates(passes, compare([own], MODEL, found.values, 1))
