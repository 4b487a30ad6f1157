"""Effects that no linear look can judge: which are tried, from what sizes, until when."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.free_form import along, free_form, rubbing, unnamed
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.searching import elsewhere
from clearance.diagnosis.searching.beside import FAR
from clearance.diagnosis.searching.elsewhere import (
    _again,
    _of_other_sizes,
    _Tried,
    _try_out,
    begin_inside,
    begin_plausible,
    begin_sure,
)
from clearance.diagnosis.searching.explanation import Explanation
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.attempts import attempt

GROUPS = sorted(
    gather(
        load_effects(["guide_friction", "restitution", "soft_drive"], []),
        Setting(SliderCrank(), "C").with_clearance(3e-4), "C", ("rod_c_axial",),
    ).values(),
    key=lambda group: ("guide_friction", "restitution", "soft_drive").index(group[0].name),
)  # fmt: skip


def test_what_a_look_is_sure_of_is_followed_anew_until_all_is_settled(monkeypatch):
    def hint(name, gain, fault=None):
        return SimpleNamespace(hypotheses=(SimpleNamespace(name=name, fault=fault),), values=[0.3], gain=gain)

    hints = [
        hint("worn_bearing", 200.0), hint("sensor_gain", 190.0, "gain"), hint("contact_stiffness", 180.0),
        hint("restitution", 170.0), hint("gravity", 20.0),
    ]  # fmt: skip
    explanation, tried = Explanation(attempt([], 1.18), [], hints), []

    def keep(explanation, held, make, again):
        assert again  # a fit beside the nominal path explains already, with a wrong size
        tried.append(held[0].name)
        if held[0].name == "contact_stiffness":
            explanation.attempts.append(attempt(["contact_stiffness"], 1.0))

    monkeypatch.setattr(elsewhere, "beside", lambda base, held, values: (held, values))
    begin_sure(SimpleNamespace(late=lambda: False, keep=keep), explanation)
    assert tried == ["worn_bearing", "contact_stiffness"]
    begin_sure(SimpleNamespace(late=lambda: True, keep=keep), Explanation(attempt([], 1.18), [], hints))
    assert len(tried) == 2


def test_what_is_missing_inside_a_joint_is_not_looked_for_outside(monkeypatch):
    asked = []
    monkeypatch.setattr(
        elsewhere,
        "_try_out",
        lambda *of: asked.append({g[0].name for g in of[3]}),
    )
    nominal = attempt([], 400.0)
    effects = load_effects(["guide_friction", "restitution", "soft_drive", "worn_bearing"], [])
    groups = gather(effects, Setting(SliderCrank(), "C").with_clearance(3e-4), "C", ("rod_c_axial",)).values()
    search = SimpleNamespace(others=lambda _: list(groups))
    for balanced in (False, True):
        begin_plausible(search, Explanation(nominal, balanced=balanced), nominal)
    assert asked == [{"guide_friction", "soft_drive", "worn_bearing"}, {"worn_bearing"}]
    near = attempt([], FAR - 0.1)  # a linear look tells more than plausible sizes do
    begin_plausible(search, Explanation(near), near)
    assert len(asked) == 2


@pytest.mark.parametrize(
    ("effects", "tables"),
    [
        (["joint_lubrication", "joint_friction", "restitution"], set()),
        (["joint_lubrication", "restitution"], {"tangential"}),
        (["joint_friction"], {"damping"}),
        (["gravity"], {"damping", "tangential"}),
    ],
)
def test_what_resists_in_a_joint_and_has_no_name_is_tried_from_plausible_tables(monkeypatch, effects, tables):
    asked = []
    most = []

    def try_out(*of):
        asked.extend(of[3])
        most.append(of[5])

    monkeypatch.setattr(elsewhere, "_try_out", try_out)
    setting = Setting(SliderCrank(), "C")
    groups = gather(load_effects(effects, []), setting.with_clearance(3e-4), "C", ())
    nominal = attempt([], 60.0)
    nominal.fit.values = np.array([[3e-4, 700.0]])
    search = SimpleNamespace(
        groups=groups, others=lambda _: list(groups.values()), setting=setting,
        profile=SimpleNamespace(best=3e-4),
    )  # fmt: skip
    begin_inside(search, Explanation(nominal), nominal)
    free = [group for group in asked if unnamed(group) is not None]
    assert {group[0].direction for group in free} == tables
    assert {group[0].direction: len(group) for group in free} == {
        direction: {"damping": 4, "tangential": 3}[direction] for direction in tables
    }
    assert max(map(len, asked)) <= most[0]  # none is left out, the thinnest film neither
    named = {group[0].name for group in asked if unnamed(group) is None}
    assert named == set(effects) - {"gravity"}


def test_a_table_of_friction_is_a_line_through_nothing():
    curve = rubbing("B", 0.2)
    np.testing.assert_allclose(along(curve, np.array([0.0, 40.0, 3000.0])), [0.0, 8.0, 600.0])
    law = free_form(curve, "B").apply(SliderCrank(joint_b=Joint(3e-4)), curve.forces).force
    assert (law.body, law.direction, law.argument) == ("joint_b", "tangential", "force_b")


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
        setting=SimpleNamespace(model=lambda held: None, with_clearance=lambda _: SliderCrank()),
        finished=SimpleNamespace(followed=lambda *_: (None, np.zeros(3), 1.0)),
    )  # fmt: skip
    each = list({group[0].name: group for group in GROUPS}.values())
    _try_out(search, explanation, nominal, each[:2], None)
    assert fitted == ["guide_friction", "restitution"]


@pytest.mark.parametrize(
    ("name", "misfits", "begun", "expected"),
    [
        ("rod_flexibility", [2.5, 0.99], [0.01, 0.03], 0.99),  # dampings
        ("rod_flexibility", [None, 2.5, 30.0], [0.01, 0.03, 0.05], 2.5),
        ("rod_flexibility", [50.0, None, 40.0], [0.01, 0.03, 0.05], 39.3),
        ("guide_friction", [14.0, 1.05], [0.006, 0.03], 1.05),  # its second number, as it was found
        ("guide_friction", [14.0, 13.0], [0.006, 0.03], 14.0),  # hardly better: it leads nowhere
        ("guide_friction", [None], [0.006], 39.3),
    ],
)
def test_what_is_followed_badly_is_followed_again_from_what_was_found(
    monkeypatch, name, misfits, begun, expected
):
    rows, left = [], iter(misfits)

    def grow(start, model, row, limit):
        rows.append(row.tolist())
        misfit = next(left)
        return None if misfit is None else ("its path", np.array([9.6e-4, 346.0, 0.03, 700.0]), misfit)

    monkeypatch.setattr(elsewhere, "grow", grow)
    monkeypatch.setattr(elsewhere, "start_with", lambda *_: None)
    search = SimpleNamespace(
        setting=Setting(SliderCrank(), "C"), late=lambda: False, report=lambda _: None,
        finished=SimpleNamespace(followed=lambda label, make: make()),
    )  # fmt: skip
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    hypothesis = next(iter(gather(load_effects([name], []), machine, "C", ()).values()))[0]
    first = _Tried(39.3, [hypothesis], np.array([9.6e-4, 343.8, 0.006, 700.0]))
    assert _again(search, first, 0, 50.0, "nominal").misfit == expected
    assert [row[2] for row in rows] == pytest.approx(begun)


def test_plausible_sizes_are_tried_before_other_shapes_of_one():
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    (group,) = gather(load_effects(["rod_flexibility"], []), machine, "C", ()).values()
    first = _of_other_sizes(group)[:3]
    assert [one.start[0] for one in first] == [300.0, 800.0, 2000.0]
    assert len({one.start[1] for one in first}) == 1
    assert len(_of_other_sizes(group)) == len(group)


@pytest.mark.parametrize(
    ("shown", "inside", "expected"),
    [
        (4e-4, 2.0, [("inside", 4e-4), ("elsewhere", 4.2e-4)]),
        (4e-4, 1.0, [("inside", 4e-4)]),  # which explains
        (4.4e-4, 2.0, []),  # the same path
        (2e-4, 2.0, [("elsewhere", 2e-4)]),  # two paths: what is inside was begun from the motion's
    ],
)
def test_other_clearances_than_the_nominal_one_are_begun_from_at_last(monkeypatch, shown, inside, expected):
    asked, nominal = [], attempt([], 50.0)
    nominal.fit.values = np.array([[4.41e-4, 700.0]])
    explanation = Explanation(nominal)

    def begin_inside(search, explanation, base, clearance):
        asked.append(("inside", clearance))
        explanation.attempts.append(attempt(["joint_friction"], inside))

    monkeypatch.setattr(elsewhere, "begin_inside", begin_inside)
    monkeypatch.setattr(
        elsewhere, "begin_elsewhere", lambda _, __, ___, clearance: asked.append(("elsewhere", clearance))
    )
    search = SimpleNamespace(profile=SimpleNamespace(best=shown), late=lambda: False)
    elsewhere.begin_displaced_paths(search, explanation)
    assert [name for name, _ in asked] == [name for name, _ in expected]
    assert [at for _, at in asked] == pytest.approx([at for _, at in expected])


@pytest.mark.parametrize("anew", [False, True])
def test_beside_what_the_nominal_machine_lacks_a_path_is_sought_with_it(monkeypatch, anew):
    own = SimpleNamespace(trace=SimpleNamespace(speed=700.0))
    sought = SimpleNamespace(trace=SimpleNamespace(speed=683.1))
    followed = []

    def grow(start, model, row, limit):
        followed.append((start, row.tolist()))
        return "follower", row, 0.9

    monkeypatch.setattr(elsewhere, "start_with", lambda *_: own)
    monkeypatch.setattr(elsewhere, "grow", grow)
    search = SimpleNamespace(
        setting=SimpleNamespace(model=lambda held: "model"), sought=lambda r, model, row: sought,
        finished=SimpleNamespace(followed=lambda label, make: make()), report=lambda _: None,
    )  # fmt: skip
    film = SimpleNamespace(label="joint_lubrication")
    row = np.array([3.4e-4, 880.0, 1.0, 700.0])
    (tried,) = elsewhere._on_one(search, [film], row, 0, 300.0, "spring + film", anew)
    assert tried.misfit == 0.9
    assert followed == [(sought, [3.4e-4, 880.0, 1.0, 683.1]) if anew else (own, row.tolist())]
