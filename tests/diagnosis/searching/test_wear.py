"""The lobes of a bearing, from the motion alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.kinematics.agreement import profile
from clearance.diagnosis.kinematics.reconstruction import reconstruct
from clearance.diagnosis.searching.wear import suggest_wear
from clearance.mechanism.bearing import Worn
from tests.diagnosis.kinematics import test_reconstruction as own
from tests.diagnosis.searching.test_geometry import NOMINAL, traced

CLEARANCE, LOBES = 2e-4, Worn(amplitude=3e-5, order=2, phase=0.8)


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


def known(search, name="", size=0.0):
    """An attempt that knows one effect and its size, or nothing."""
    held = [group[0] for group in search.groups.values() if group[0].name == name]
    values = np.array([[CLEARANCE, *[size] * len(held), 700.0]])
    return SimpleNamespace(
        hypotheses=held, fit=SimpleNamespace(values=values), model=search.setting.model(held)
    )


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, -3e-3])
def test_the_lobes_are_told_by_the_motion_beside_what_is_known(offset):
    search = traced(worn(replace(NOMINAL, guide_offset=offset), "C", LOBES))
    found = suggest_wear(search, known(search, "slider_offset" if offset else "", offset))
    assert found.values[1] == LOBES.order
    order = found.hypothesis.unknowns[1]
    assert order.low <= LOBES.order <= order.high
    assert found.values[0] == pytest.approx(LOBES.amplitude, rel=0.25)
    assert np.angle(np.exp(1j * (found.values[2] - LOBES.phase))) == pytest.approx(0.0, abs=0.3)
    assert found.clearance == pytest.approx(CLEARANCE, rel=0.05)
    assert found.share < 0.97


def test_a_wear_that_is_not_among_the_hypotheses_is_not_looked_for():
    assert suggest_wear(SimpleNamespace(groups={}), SimpleNamespace(hypotheses=())) is None
