"""The lobes of a bearing, from the motion alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.kinematics.agreement import profile
from clearance.diagnosis.kinematics.bore import Bore
from clearance.diagnosis.kinematics.reconstruction import reconstruct
from clearance.diagnosis.searching.wear import suggest_wear
from clearance.mechanism.bearing import Worn
from tests.diagnosis.kinematics import test_reconstruction as own
from tests.diagnosis.searching.test_geometry import NOMINAL, traced

FELT = SimpleNamespace(rod_angle=0.0)
CLEARANCE, LOBES = 2e-4, Worn(amplitude=3e-5, order=2, phase=0.8)


def direction(angle):
    """(samples, 2) unit vectors."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def worn(machine, joint, lobes):
    name = f"joint_{joint.lower()}"
    return replace(machine, **{name: replace(getattr(machine, name), bearing=lobes)})


@pytest.mark.parametrize("joint", ["B", "C"])
def test_a_journal_keeps_to_a_bore_that_is_not_round(joint):
    made = worn(own.machine(joint, CLEARANCE), joint, LOBES)
    measured, states = own.recorded(made)
    known = own.aligned(states)
    true = own.eccentricities(made, states, joint)[:: own.SAMPLES][5:-5]
    missed, misfits = [], []
    for machine in (own.machine(joint, CLEARANCE), made):
        found = reconstruct(measured, machine.parameters(), (joint,), known.speed, known.angle)
        miss = own.in_nodes(found.nodes, joint, CLEARANCE)[5:-5] - true
        missed.append(np.median(np.hypot(*miss.T)))
        misfits.append(found.misfit)
    assert missed[1] < 0.6 * missed[0]
    assert misfits[1] < misfits[0]


@pytest.mark.parametrize(("order", "share"), [(2, 0.1), (4, 0.14)])
def test_a_journal_rests_where_its_force_is_normal_to_the_bore(order, share):
    bore = Bore("C", CLEARANCE, 1e10, share * CLEARANCE, order, 0.8)  # four lobes of 14 % turn it back
    angle = np.linspace(-np.pi, np.pi, 400)
    place = bore.radius(direction(angle), FELT)[:, None] * direction(angle)
    normal = direction(angle - bore.tilt(place, FELT))
    along, across = bore.rest(normal, FELT, place)
    sideways = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    found = along[:, None] * normal + across[:, None] * sideways
    np.testing.assert_allclose(found, place, atol=0.03 * CLEARANCE)


def test_a_journal_of_which_only_the_force_is_known_is_pressed_as_far_as_it_goes():
    bore = Bore("C", CLEARANCE, 1e10, 0.14 * CLEARANCE, 4, 0.0)
    angle = np.linspace(-np.pi, np.pi, 721)
    farthest = (bore.radius(direction(angle), FELT) * np.cos(angle[:, None] - angle)).max(axis=1)
    along, _ = bore.rest(direction(angle), FELT)
    np.testing.assert_allclose(along, farthest, rtol=1e-3)


def test_a_model_with_a_worn_bore_is_compared_where_its_lobes_leave_a_gap():
    made = worn(own.machine("C", CLEARANCE), "C", LOBES)
    measured, states = own.recorded(made)

    def machine(clearance):
        return worn(own.machine("C", clearance), "C", LOBES)

    found = profile([measured], [own.aligned(states)], machine, 1)
    closed = found.clearance <= LOBES.amplitude
    assert closed.any()
    assert np.isinf(found.misfit[closed]).all()
    assert np.isfinite(found.misfit[~closed]).all()
    assert found.best == pytest.approx(CLEARANCE, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, -3e-3])
def test_the_lobes_are_told_by_the_motion_beside_what_is_known(offset):
    search = traced(worn(replace(NOMINAL, guide_offset=offset), "C", LOBES))
    held = [group[0] for group in search.groups.values() if offset and group[0].name == "slider_offset"]
    found = suggest_wear(search, held, np.full(len(held), offset))
    assert found.values[1] == LOBES.order
    order = found.hypothesis.unknowns[1]
    assert order.low <= LOBES.order <= order.high
    assert found.values[0] == pytest.approx(LOBES.amplitude, rel=0.25)
    assert np.angle(np.exp(1j * (found.values[2] - LOBES.phase))) == pytest.approx(0.0, abs=0.3)
    assert found.clearance == pytest.approx(CLEARANCE, rel=0.05)
    assert found.share < 0.97


def test_a_wear_that_is_not_among_the_hypotheses_is_not_looked_for():
    assert suggest_wear(SimpleNamespace(groups={}), [], np.zeros(0)) is None
