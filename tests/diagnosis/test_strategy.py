"""In which order explanations are tried, and when the search goes on."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.effect import load_effects
from clearance.diagnosis.elsewhere import _try_out, begin_plausible
from clearance.diagnosis.explain import Explanation
from clearance.diagnosis.hypothesis import Setting, gather
from clearance.diagnosis.strategy import _enough
from clearance.diagnosis.verdict import unsettled
from clearance.diagnosis.widen import glaring
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.test_verdict import attempt

GROUPS = sorted(
    gather(
        load_effects(["guide_friction", "restitution", "soft_drive"], []),
        Setting(SliderCrank(), "C").with_clearance(3e-4), "C", ("rod_c_axial",),
    ).values(),
    key=lambda group: ("guide_friction", "restitution", "soft_drive").index(group[0].name),
)  # fmt: skip


@pytest.mark.parametrize(
    ("nominal", "gain", "small", "expected"),
    [
        (1.02, 10.0, [], False),  # nothing is missing
        (1.02, 200.0, [], True),
        (1.19, 200.0, [1.18], True),  # a second clearance was taken for a heavier rod
        (1.19, 200.0, [1.01], False),
        (1.06, 200.0, [1.04], False),  # what a right model may leave
        (50.0, 200.0, [], False),
    ],
)
def test_something_small_that_leaves_most_does_not_end_the_search(nominal, gain, small, expected):
    attempts = [attempt(["rod_inertia"], misfit) for misfit in small]
    explanation = Explanation(attempt([], nominal), attempts, [SimpleNamespace(gain=gain)])
    assert unsettled(explanation) == expected


@pytest.mark.parametrize(
    ("nominal", "misfit", "expected"),
    [(200.0, 1.2, True), (200.0, 3.0, True), (200.0, 15.0, False), (8.0, 3.0, False)],
)
def test_a_table_ends_the_search_where_only_its_shape_can_be_missing(nominal, misfit, expected):
    assert _enough(Explanation(attempt([], nominal), [attempt(["free_form"], misfit)])) == expected


@pytest.mark.parametrize(
    ("loud", "scale", "expected"),
    [
        ({1: 10.0}, 1.0, "rod_c_axial"),
        ({1: 10.0, 2: 2.0}, 1.0, None),  # another one contradicts, too
        ({1: 1.2}, 1.0, None),
        ({1: 10.0}, 4.0, None),  # beside a smoothed path nothing is sure
    ],
)
def test_a_sensor_that_alone_contradicts_the_nominal_machine_glares(loud, scale, expected):
    residual = np.random.default_rng(0).normal(size=(60, 10, 3))
    for channel, factor in loud.items():
        residual[:, :, channel] *= factor
    measured = SimpleNamespace(channels=("rod_b_axial", "rod_c_axial", "slider_horizontal"))
    base = SimpleNamespace(
        scale=scale, fit=SimpleNamespace(passes=[SimpleNamespace(residual=residual)]),
        followers=[SimpleNamespace(measured=measured)],
    )  # fmt: skip
    assert glaring(base) == expected


def test_what_is_missing_inside_a_joint_is_not_looked_for_outside(monkeypatch):
    asked = []
    monkeypatch.setattr(
        "clearance.diagnosis.elsewhere._try_out", lambda *of: asked.append({g[0].name for g in of[3]})
    )
    nominal = attempt([], 400.0)
    search = SimpleNamespace(others=lambda _: GROUPS)
    for balanced in (False, True):
        begin_plausible(search, Explanation(nominal, balanced=balanced), nominal)
    assert asked == [{"guide_friction", "restitution", "soft_drive"}, {"restitution"}]


def test_each_candidate_is_tried_though_something_small_explains():
    fitted = []
    nominal, small = attempt([], 1.19), attempt(["rod_inertia"], 1.18)
    explanation = Explanation(nominal, [small])
    for one in (nominal, small):
        one.misfits, one.label, one.fit.values = [one.misfit], "one", np.array([[3e-4, 700.0]])
        one.model = SimpleNamespace(shared=1)
    search = SimpleNamespace(
        starts=[SimpleNamespace(doubt=1.0)], late=lambda: False, report=lambda _: None,
        keep=lambda _, held, make: fitted.append(held[-1].name),
        setting=SimpleNamespace(model=lambda held: None),
        finished=SimpleNamespace(followed=lambda *_: (None, np.zeros(3), 1.0)),
    )  # fmt: skip
    each = list({group[0].name: group for group in GROUPS}.values())
    _try_out(search, explanation, nominal, each[:2], None)
    assert fitted == ["guide_friction", "restitution"]
