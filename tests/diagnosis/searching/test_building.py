"""What is looked for beside parts that were found, and in which order."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.searching.course import Course, search_all
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.free_search import reshape_anew
from clearance.diagnosis.searching.widen import Prospects
from tests.diagnosis.attempts import attempt

pytestmark = pytest.mark.usefixtures("still")


@pytest.mark.parametrize(("misfit", "expected"), [(1.02, []), (5.0, ["sensor_gain + worn_bearing"])])
def test_two_parts_that_do_not_explain_are_followed_on_paths_of_their_own(stand_in, misfit, expected):
    again = []
    nominal = attempt([], 40.0)
    explanation = Explanation(nominal, [attempt(["sensor_gain"], 11.0)])

    def widen(search, explanation, base, hints):
        if base is not nominal:
            pair = attempt(["sensor_gain", "worn_bearing"], misfit)
            pair.label = "sensor_gain + worn_bearing"
            explanation.attempts.append(pair)

    prospects = Prospects([], [], [], [], [])
    for name in ("glaring", "enlarge", "reshape", "reshape_anew", "begin_elsewhere", "begin_clock"):
        stand_in(name, lambda *_: None)
    stand_in("look", lambda *_: prospects)
    stand_in("widen", widen)
    stand_in("begin_again", lambda _, found: again.append(found.best.label))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: len(again) > 0)
    search.most = 3
    search_all(search, explanation, lambda _: None)
    assert again == expected


@pytest.mark.parametrize(
    ("obvious", "expected"),
    [(True, ["balance", "beside", "table"]), (False, ["table", "balance", "beside"])],
)
def test_what_promises_most_beside_a_part_comes_before_a_table_in_its_place(fruitless, obvious, expected):
    asked = []
    nominal, gravity = attempt([], 40.0), attempt(["gravity"], 2.0)
    hint = SimpleNamespace(hypotheses=(SimpleNamespace(name="soft_drive", fault=None, channel=None),))
    beside = Prospects([hint], [], [], [], []) if obvious else Prospects([], [hint], [], [], [])
    none = Prospects([], [], [], [], [])
    fruitless("look", lambda _, __, base: none if base is nominal else beside)
    fruitless("reshape", lambda *_: asked.append("table"))
    fruitless("begin_beside", lambda *_: asked.append("balance"))
    fruitless("widen", lambda *of: asked.append("beside") if of[3] == [hint] else None)
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: len(asked) > 2)
    search.most = 3
    search_all(search, Explanation(nominal, [gravity]), lambda _: None)
    assert asked[:3] == expected


@pytest.mark.parametrize(("name", "fault"), [("slider_offset", None), ("sensor_gain", "gain")])
@pytest.mark.parametrize(("misfit", "expected"), [(1.0, ["beside"]), (3.0, ["beside", "table"])])
def test_a_dimension_or_a_fault_beside_a_name_comes_before_a_table_in_its_place(
    fruitless, name, fault, misfit, expected
):
    """Friction left 4 to a guide line that was 1.7 mm off; tables took the time, and less off."""
    asked = []
    nominal, friction = attempt([], 474.0), attempt(["guide_friction"], 3.8)
    hints = [
        SimpleNamespace(hypotheses=(SimpleNamespace(name=one, fault=kind, channel=None),))
        for one, kind in (("torque_ripple", None), (name, fault))
    ]
    none = Prospects([], [], [], [], [])
    fruitless("look", lambda _, __, base: Prospects([], hints, [], [], []) if base is friction else none)
    fruitless("reshape", lambda *_: asked.append("table"))

    def follow(explanation, base, hint):
        assert (base, hint) == (friction, hints[1])
        asked.append("beside")
        explanation.attempts.append(attempt(["guide_friction", name], misfit))

    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: len(asked) > 1, most=2)
    search.follow = follow
    search_all(search, Explanation(nominal, [friction]), lambda _: None)
    assert asked == expected


@pytest.mark.parametrize(
    ("left", "expected"),
    [
        (9.0, [["slider_offset"], "wear", ["worn_bearing", "guide_friction"]]),
        (2.0, [["slider_offset"], ["worn_bearing", "guide_friction"], "wear"]),  # a look tells them, if near
    ],
)
def test_what_promises_more_than_lobes_beside_a_part_is_tried_before_them(stand_in, left, expected):
    asked = []
    nominal, gravity = attempt([], 40.0), attempt(["gravity"], left)
    hints = [
        SimpleNamespace(hypotheses=(SimpleNamespace(name=name, fault=None),))
        for name in ("slider_offset", "worn_bearing", "guide_friction")
    ]
    for name in (
        "glaring", "enlarge", "reshape", "reshape_anew", "begin_elsewhere", "begin_again", "begin_clock",
        "begin_displaced", "suggest_channels", "suggest_dimensions",
    ):  # fmt: skip
        stand_in(name, lambda *_: {})
    none = Prospects([], [], [], [], [])
    stand_in(
        "look",
        lambda _, __, base: none if base is nominal else Prospects([], hints[:1], hints[1:], [], []),
    )
    stand_in("widen", lambda _, __, ___, some: asked.append([h.hypotheses[0].name for h in some]))
    stand_in("begin_wear", lambda *_: asked.append("wear"))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: len(asked) > 2)
    search.most, search.follow = 3, lambda *_: None
    search_all(search, Explanation(nominal, [gravity]), lambda _: None)
    assert asked == expected


@pytest.mark.parametrize(("left", "anew"), [(14.7, True), (30.0, False)])
def test_a_table_in_an_effect_s_place_is_sought_anew_where_its_path_is_far(monkeypatch, left, anew):
    """On the torn path of viscous friction a table of the velocity leaves more than the friction does."""
    asked = []
    monkeypatch.setattr(
        "clearance.diagnosis.searching.free_search.seek_anew",
        lambda search, found, held, values, table, again: asked.append(table),
    )
    search = SimpleNamespace(late=lambda: False)
    friction, table = attempt(["guide_friction"], 11.2), attempt([FREE_FORM], left)
    table.fit.values = None
    reshape_anew(search, Explanation(attempt([], 891.0), [friction, table]), friction, [table])
    assert asked == ([table] if anew else [])
    near = attempt(["guide_friction"], 2.0)
    reshape_anew(search, Explanation(attempt([], 891.0), [near, table]), near, [table])
    assert len(asked) == anew


@pytest.mark.parametrize(
    ("left", "expected"), [(700.0, ["inside", "elsewhere"]), (15.0, ["elsewhere", "inside"])]
)
def test_what_acts_inside_the_joint_is_asked_first_beside_a_part_that_is_far(fruitless, left, expected):
    asked, nominal, clock = [], attempt([], 8000.0), attempt(["timebase"], left)
    clock.fit.values = np.zeros((1, 3))
    for name in ("inside", "elsewhere"):
        fruitless(f"begin_{name}", lambda _, __, base, name=name, **how: asked.append((name, base)))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False)
    search.most = 2
    search_all(search, Explanation(nominal, [clock]), lambda _: None)
    assert [name for name, base in asked if base is clock] == expected


@pytest.mark.parametrize(("misfit", "expected"), [(5.3, ["joint_lubrication"]), (9.0, [])])
def test_one_of_two_that_share_what_is_missing_is_looked_beside_at_last(fruitless, misfit, expected):
    beside = []
    fruitless("begin_beside", lambda _, __, base: beside.extend(h.name for h in base.hypotheses))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: len(beside) > 0)
    explanation = Explanation(attempt([], 12.2), [attempt(["joint_lubrication"], misfit)])
    search.most = 3
    search_all(search, explanation, lambda _: None)
    assert beside == expected


def test_beside_a_larger_variant_others_are_looked_for_once(fruitless):
    beside, smaller, larger = [], attempt(["guide_friction"], 9.0), attempt(["guide_friction"], 5.0)
    smaller.fit.values = larger.fit.values = np.zeros((1, 3))

    def enlarge(search, explanation):
        if larger not in explanation.attempts:
            explanation.attempts.append(larger)

    fruitless("enlarge", enlarge)
    fruitless("begin_beside", lambda _, __, base: beside.append(base))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False, most=2)
    search_all(search, Explanation(attempt([], 300.0), [smaller]), lambda _: None)
    assert beside == [larger]


@pytest.mark.parametrize(("misfit", "expected"), [(1.02, 0), (3.1, 1)])
def test_what_is_nearly_explained_is_fitted_again_on_paths_of_its_own(fruitless, misfit, expected):
    again = []
    fruitless("begin_again", lambda _, found: again.append(found.best))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False)
    pair = attempt(["second_clearance", "joint_friction"], misfit)
    search.most = 2
    search_all(search, Explanation(attempt([], 723.0), [pair]), lambda _: None)
    assert again == [pair] * expected


@pytest.mark.parametrize(("name", "forces"), [("soft_drive", True), ("guide_clearance", False)])
def test_between_rails_a_part_counts_as_a_force_unless_it_is_these_rails(fruitless, name, forces):
    """Play beside play in the same guide took three minutes, and hid what one alone explains."""
    part, asked = attempt([name], 5.0), []
    part.fit.values, part.model.shared = np.array([[3e-4, 7.0, 70.0]]), 2
    fruitless("begin_guide", lambda search, explanation, *given, most=1.0: asked.append(given) or False)
    fruitless("unfinished", lambda *_: part)
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False)
    search.most = 2
    begun = Course(search, Explanation(attempt([], 10.0), [part]))
    begun.built_on.append(part)
    begun.motion()
    assert [given[1:2] for given in asked] == [(part.hypotheses,) if forces else ()]
