"""What the balance of work points at together: which forces and pairs are followed, and until when."""

from contextlib import contextmanager, nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.searching import from_work
from clearance.diagnosis.searching.balance import Suggested
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.from_work import (
    begin_balanced,
    begin_beside,
    begin_misheard,
    begin_pairs,
)
from clearance.diagnosis.searching.geometry import Dimension
from clearance.diagnosis.searching.work import Balanced
from tests.diagnosis.attempts import attempt


def pair(*names):
    hypotheses = tuple(
        SimpleNamespace(name=name, label=name, body="slider", direction="x", shapes=np.zeros(1, bool))
        for name in names
    )
    return Balanced(hypotheses, np.ones(len(names)), 2.0, 3e-4)


def nominal(misfit, clearance=3e-4):
    one = attempt([], misfit)
    one.fit.values = np.array([[clearance, 700.0]])
    return one


def table_on_slider(argument):
    return SimpleNamespace(
        name="free_form",
        label=f"free_form({argument})",
        body="slider",
        direction="x",
        shapes=np.zeros(1, bool),
    )


def follow(monkeypatch, suggested, fit, misfit, most, motion=lambda *_, **__: False):
    """Let a search beside a nominal machine with a misfit follow what the balance of work suggests."""
    for name in ("begin_guide", "begin_wear", "begin_inside", "begin_elsewhere"):
        monkeypatch.setattr(from_work, name, lambda *of, name=name, **more: motion(name, *of, **more))
    monkeypatch.setattr(from_work, "_with", lambda nominal, setting, one: one)
    monkeypatch.setattr(from_work, "suggest_forces", lambda *_: suggested)
    monkeypatch.setattr(from_work, "settle_in", lambda search, setting, one: one)
    monkeypatch.setattr(from_work, "fit_from", fit)
    search = SimpleNamespace(
        setting=None, report=lambda _: None, late=lambda: False, timed=lambda _: nullcontext(),
        profile=SimpleNamespace(best=3e-4),
    )  # fmt: skip
    search.most = most
    begin_balanced(search, Explanation(nominal(misfit)))


PAIRS = [
    pair("slider_spring", "soft_drive"),
    pair("soft_drive", "slider_spring"),  # the same two
    pair("slider_spring", "process_load"),
    pair("process_load", "torque_ripple"),
    pair("process_load", "rod_inertia"),
    pair("process_load", "gravity"),
    pair("process_load", "guide_friction"),
]


@pytest.mark.parametrize(("right", "count"), [("process_load", 2), ("", 5)])
def test_pairs_are_followed_until_one_nearly_explains(monkeypatch, right, count):
    tried = []

    def fit(search, explanation, base, hypotheses, values, clearance, anew, insist):
        assert anew  # the nominal machine's paths are those of a machine that lacks both
        tried.append({h.name for h in hypotheses})
        return attempt(["both"], 1.0 if tried[-1] == {"slider_spring", right} else 700.0)

    monkeypatch.setattr(from_work, "settle_in", lambda search, setting, one: one)
    monkeypatch.setattr(from_work, "fit_from", fit)
    search = SimpleNamespace(
        setting=None,
        report=lambda _: None,
        late=lambda: False,
        timed=lambda _: nullcontext(),
    )
    begin_pairs(search, Explanation(nominal(1000.0)), PAIRS)
    assert len(tried) == count
    assert tried[0] == {"slider_spring", "soft_drive"}
    assert all(one not in tried[:i] for i, one in enumerate(tried))


@pytest.mark.parametrize(
    ("misfit", "fault", "channel", "expected"),
    [
        (30.0, None, None, ["guide_friction"]),
        (2.0, None, None, []),
        (30.0, "gain", "rod_b_axial", ["guide_friction"]),  # whose channel is not asked
        (30.0, "timebase", None, []),
    ],
)
def test_beside_a_part_the_balance_of_work_is_asked_again(monkeypatch, misfit, fault, channel, expected):
    part = attempt(["gravity"], misfit)
    part.fit.values = np.array([[3e-4, -9.9, 700.0]])
    part.hypotheses[0].fault, part.hypotheses[0].apply = fault, lambda machine, sizes: f"{machine} {sizes[0]}"
    part.hypotheses[0].channel = channel
    asked, fitted, silent = [], [], []
    again, friction = pair("gravity"), pair("guide_friction")

    def suggest(search, setting, clearance, named):
        asked.append((setting.machine, clearance, named, list(silent)))
        return SimpleNamespace(forces=[again, friction])

    def fit(search, explanation, base, hypotheses, values, clearance, anew, insist):
        fitted.append([h.name for h in hypotheses])
        np.testing.assert_array_equal(values, [-9.9, 1.0])
        return attempt(["both"], 1.0)

    monkeypatch.setattr(from_work, "suggest_forces", suggest)
    monkeypatch.setattr(from_work, "settle_in", lambda search, setting, one: one)
    monkeypatch.setattr(from_work, "same", lambda one, other: one.name == other.name)
    monkeypatch.setattr(from_work, "fit_from", fit)
    monkeypatch.setattr(from_work, "profile", lambda *_: SimpleNamespace(best=4e-4))
    setting = Setting("machine", "C")

    recordings = [SimpleNamespace(without=lambda channel: channel)]

    @contextmanager
    def hearing(heard):
        silent.extend(heard if heard is not recordings else [])
        yield
        silent.clear()

    search = SimpleNamespace(
        setting=setting, profile=SimpleNamespace(best=3e-4), late=lambda: False, report=lambda _: None,
        timed=lambda _: nullcontext(), hearing=hearing, workers=1, recordings=recordings, alignments=[],
        most=2,
    )  # fmt: skip
    begin_beside(search, Explanation(nominal(1000.0), [part]), part)
    assert fitted == [["gravity", name] for name in expected]
    heard = (3e-4, True, []) if channel is None else (4e-4, True, [channel])
    assert asked == ([("machine -9.9", *heard)] if expected else [])


def test_a_force_beside_a_sensor_s_fault_is_asked_of_what_it_would_show_without_the_fault(monkeypatch):
    """Without gravity a gain of 1.36 was not followed, nor gravity by a sensor that shows as much more."""
    gain = SimpleNamespace(name="sensor_gain", fault="gain", channel="slider_horizontal")
    asked, fitted, heard = [], [], []

    @contextmanager
    def hearing(recordings):
        heard.extend(recordings)
        yield
        heard.clear()

    def suggest(search, setting, clearance, named):
        asked.append((clearance, named, list(heard)))
        return SimpleNamespace(forces=[pair("gravity", "soft_drive"), pair("gravity")])  # three are too many

    def fit(search, explanation, base, hypotheses, values, clearance, anew, insist):
        fitted.append(([h.name for h in hypotheses], list(values), clearance))
        return attempt(["both"], 1.0)

    setting = SimpleNamespace(
        model=lambda held: SimpleNamespace(instrument=lambda values: f"{held[0].fault} {values[1]}"),
        added=lambda held, sizes: SimpleNamespace(with_clearance=None),
    )
    monkeypatch.setattr(from_work, "suggest_forces", suggest)
    monkeypatch.setattr(from_work, "settle_in", lambda search, setting, one: one)
    monkeypatch.setattr(from_work, "same", lambda one, other: one.name == other.name)
    monkeypatch.setattr(from_work, "fit_from", fit)
    monkeypatch.setattr(from_work, "profile", lambda *_: SimpleNamespace(best=4e-4))
    search = SimpleNamespace(
        setting=setting, profile=SimpleNamespace(best=3e-4), late=lambda: False, report=lambda _: None,
        timed=lambda _: nullcontext(), hearing=hearing, workers=1, alignments=[], most=2,
        recordings=[SimpleNamespace(undone=lambda instrument: f"undone {instrument}")],
    )  # fmt: skip
    begin_misheard(search, Explanation(nominal(90.0)), Dimension(gain, 1.36, 2.6e-4, 0.09))
    assert asked == [(4e-4, True, ["undone gain 1.36"])]
    assert fitted == [(["sensor_gain", "gravity"], [1.36, 1.0], 3e-4)]


@pytest.mark.parametrize("weak", [False, True])
@pytest.mark.parametrize(("follows", "expected"), [(12, [12]), (6, [12, 6]), (0, [12, 6])])
def test_a_table_that_is_not_followed_is_tried_with_fewer_knots(monkeypatch, follows, expected, weak):
    def table(knots, fewer=None):
        curve = SimpleNamespace(
            knots=np.zeros(knots), body="slider", argument="slider_velocity", interpolation=""
        )
        hypothesis = table_on_slider("slider_velocity")
        return Balanced((hypothesis,), np.ones(knots), 2.0, 3e-4, curve, fewer=fewer)

    def fit(search, explanation, base, hypotheses, values, *more, **other):
        tried.append(len(values))
        return attempt(["free_form"], 9.0) if len(values) == follows else None

    tried, refined = [], []
    one = table(12, table(6))
    suggested = Suggested([] if weak else [one], balanced=False, weak=one if weak else None)
    monkeypatch.setattr(from_work, "refine_table", lambda *given: refined.append(len(given[2].knots)))
    follow(monkeypatch, suggested, fit, 1000.0, 2)
    assert tried == expected
    assert refined == [follows] * (follows > 0)


@pytest.mark.parametrize(
    ("left", "cost", "tables"),
    [(0.5, 1.5, 1), (0.7, 1.5, 2), (0.5, 1.9, 0), (0.7, 1.9, 2)],  # the name costs 2
)
def test_no_second_table_is_followed_where_none_says_more_than_a_name_that_does_much(
    monkeypatch, left, cost, tables
):
    def table(argument):
        curve = SimpleNamespace(knots=np.zeros(40), body="slider", argument=argument, interpolation="")
        hypothesis = table_on_slider(argument)
        return Balanced((hypothesis,), np.ones(40), cost, 3e-4, curve)

    def fit(search, explanation, base, hypotheses, *more, **other):
        tried.append(hypotheses[0].name)
        if hypotheses[0].name == "process_load":
            explanation.attempts.append(attempt(["process_load"], left * 100.0))
            return explanation.attempts[-1]
        return None

    tried = []
    forces = [pair("process_load"), table("slider_position"), table("crank_angle")]
    follow(monkeypatch, Suggested(forces, balanced=False), fit, 100.0, 2)
    assert tried == ["process_load", *["free_form"] * tables]


@pytest.mark.parametrize(
    ("other", "lacking", "most"), [(3.0, 5.0, 2), (0.5, 5.0, 2), (3.0, 0.5, 2), (3.0, 5.0, 1)]
)
def test_what_alone_gives_nearly_all_and_does_not_explain_is_one_of_two(monkeypatch, other, lacking, most):
    def single(name, cost):
        hypothesis = SimpleNamespace(
            name=name, label=name, body="crank", direction="moment", channel=None, shapes=np.zeros(1, bool)
        )
        return Balanced((hypothesis,), np.ones(1), cost, 3e-4)

    tried = []

    def fit(search, explanation, base, hypotheses, *more, **other):
        tried.append([h.name for h in hypotheses])
        return None

    drive, friction = single("soft_drive", 0.1), single("guide_friction", 2.0)
    both = Balanced((*drive.hypotheses, *friction.hypotheses), np.ones(2), 0.09, 3e-4)
    forces = [drive, single("torque_ripple", other), single("rod_inertia", 4.0)]
    suggested = Suggested(forces, balanced=False, pairs=[both], lacking=lacking)
    follow(monkeypatch, suggested, fit, 100.0, most)
    assert tried[0] == ["soft_drive"]
    first = (other, lacking, most) == (3.0, 5.0, 2)
    assert (tried[1] == ["soft_drive", "guide_friction"]) == first
    assert len(tried) == 3 + first


@pytest.mark.parametrize(
    ("both", "right", "expected"),
    [
        (0.6, False, ["guide_friction", "guide_friction + rod_inertia", "free_form"]),
        (0.6, True, ["guide_friction", "guide_friction + rod_inertia"]),
        (0.9, True, ["guide_friction", "free_form"]),
    ],
)
def test_two_that_cost_clearly_less_than_one_come_before_tables(monkeypatch, both, right, expected):
    def fit(search, explanation, base, hypotheses, *more, **other):
        tried.append(" + ".join(h.name for h in hypotheses))
        if right and len(hypotheses) == 2:
            explanation.attempts.append(attempt(["guide_friction", "rod_inertia"], 1.0))
            return explanation.attempts[-1]
        return None

    tried = []
    curve = SimpleNamespace(knots=np.zeros(12), body="slider", argument="slider_velocity", interpolation="")
    forces = [
        replace(pair("guide_friction"), cost=1.0),
        Balanced((table_on_slider("slider_velocity"),), np.ones(12), 0.9, 3e-4, curve),
    ]
    pairs = [replace(pair("guide_friction", "rod_inertia"), cost=both)]
    follow(monkeypatch, Suggested(forces, balanced=False, pairs=pairs, lacking=5.0), fit, 10.0, 2)
    assert tried == expected


def test_of_two_that_follow_nearly_each_is_tried_in_its_other_variants(monkeypatch):
    def variant(name, parameter):
        return SimpleNamespace(
            name=name, label=f"{name}({parameter})", channel=None, start=np.array([5.0]),
            unknowns=(SimpleNamespace(name=parameter),),
        )  # fmt: skip

    friction = [variant("guide_friction", one) for one in ("coulomb", "viscous")]
    found = attempt(["soft_drive", "guide_friction"], 3.0)
    found.hypotheses = (variant("soft_drive", "gain"), friction[0])
    found.fit.values = np.array([[3e-4, 1.1, 0.2, 535.0], [3e-4, 1.1, 0.2, 920.0]])
    explanation, asked = Explanation(nominal(100.0), [found]), []

    def refit(explanation, held, followers, values, scale):
        asked.append(([h.label for h in held], values.tolist()))
        explanation.attempts.append(attempt(["soft_drive", "guide_friction"], 1.0))
        return explanation.attempts[-1]

    monkeypatch.setattr(from_work, "_follow", lambda *given: found)
    groups = {one.label: [one] for one in (variant("gravity", "x"), *friction)}
    search = SimpleNamespace(setting=None, late=lambda: False, groups=groups, refit=refit)
    begin_pairs(search, explanation, [pair("soft_drive", "guide_friction"), pair("gravity", "slider_spring")])
    labels = ["soft_drive(gain)", "guide_friction(viscous)"]
    assert asked == [(labels, [[3e-4, 1.1, 5.0, 535.0], [3e-4, 1.1, 5.0, 920.0]])]
    assert explanation.best is explanation.attempts[-1]  # which explains: no other two are tried


@pytest.mark.parametrize(
    ("fitted", "follows", "expected"),
    [
        (3.3e-4, None, [3e-4, np.sqrt(3.3e-4 * 3e-4)]),
        (3.3e-4, 3e-4, [3e-4]),  # followed at once
        (3.02e-4, None, [3e-4]),  # hardly another one
        (5e-4, None, [3e-4]),  # another path
    ],
)
def test_what_the_work_suggests_begins_between_two_clearances_where_it_is_not_followed(
    monkeypatch, fitted, follows, expected
):
    tried = []

    def fit(search, explanation, base, hypotheses, values, clearance, anew, insist):
        tried.append(clearance)
        return attempt(["torque_ripple"], 1.0 if clearance == follows else 900.0)

    monkeypatch.setattr(from_work, "settle_in", lambda search, setting, one: one)
    monkeypatch.setattr(from_work, "fit_from", fit)
    search = SimpleNamespace(
        setting=None,
        report=lambda _: None,
        late=lambda: False,
        timed=lambda _: nullcontext(),
    )
    begin_pairs(search, Explanation(nominal(1000.0, fitted)), [pair("torque_ripple")])
    assert tried == pytest.approx(expected)


@pytest.mark.parametrize(
    ("cost", "most", "rails", "expected"),
    [
        (0.7, 2, False, ["begin_guide", "begin_wear", "begin_inside", "begin_elsewhere"]),
        (0.7, 2, True, ["begin_guide"]),
        (0.7, 1, False, []),
        (1.7, 2, False, []),  # it may as well be another force
    ],
)
def test_beside_a_force_that_is_surely_there_and_not_followed_the_motion_is_asked_once(
    monkeypatch, cost, most, rails, expected
):
    def motion(name, search, explanation, base=None, *more, anew=False):
        asked.append(name)
        inside = [getattr(base, "hypotheses", ())]
        held = {
            "begin_guide": [], "begin_wear": more[:1], "begin_inside": inside, "begin_elsewhere": inside,
        }  # fmt: skip
        assert [h.name for one in held[name] for h in one] == ["slider_spring"] * len(held[name])
        assert anew == (name == "begin_inside")
        return rails

    asked = []
    forces = [replace(pair("slider_spring"), cost=cost), replace(pair("soft_drive"), cost=2.0)]
    suggested = Suggested(forces, balanced=False, lacking=5.0)
    follow(monkeypatch, suggested, lambda *_, **__: None, 611.0, most, motion)
    assert asked == expected
