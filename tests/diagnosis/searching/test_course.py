"""In which order steps are tried, and when the search goes on."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.searching import building, course, scrutiny
from clearance.diagnosis.searching.course import Course, search_all
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.free_search import reshape_anew
from clearance.diagnosis.searching.scrutiny import _compare_kinds
from clearance.diagnosis.searching.significance import unsettled
from clearance.diagnosis.searching.widen import Prospects
from tests.diagnosis.judging.test_verdict import attempt


@pytest.fixture
def stand_in(monkeypatch):
    """Returns what puts something in the place of a function, in the search and in what it builds on."""

    def put(name, instead):
        users = [module for module in (course, building) if hasattr(module, name)]
        assert users, name
        for module in users:
            monkeypatch.setattr(module, name, instead)

    return put


@pytest.fixture(autouse=True)
def still(stand_in):
    """Nothing shakes the frame, one clearance, no rails, no force that the balance names, nothing lost."""
    for name in (
        "begin_frame",
        "begin_beside",
        "begin_displaced_paths",
        "begin_guide",
        "begin_patiently",
        "find_nominal",
    ):
        stand_in(name, lambda *_, **__: None)


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
    ("misfit", "channels", "left", "expected"),
    [
        (400.0, 7, 0.3, ["rod_b_axial"]),
        (400.0, 7, 0.45, []),  # the motion does not agree much better without it
        (400.0, 4, 0.3, []),  # none of four can be spared
        (10.0, 7, 0.3, []),  # the nominal path is near: other looks are cheaper
    ],
)
def test_a_sensor_that_the_motion_accuses_comes_before_forces(stand_in, misfit, channels, left, expected):
    asked = []
    nominal = attempt([], misfit)
    search = SimpleNamespace(
        recordings=[SimpleNamespace(channels=("rod_b_axial",) * channels)], late=lambda: len(asked) > 0
    )
    stand_in("look", lambda *_: Prospects([], [], [], [], []))
    stand_in("glaring", lambda _: None)
    for name in ("begin_clock", "begin_displaced", "suggest_dimensions"):
        stand_in(name, lambda *_: [])
    stand_in("suggest_channels", lambda _: {"rod_b_axial": left})
    stand_in("deafen", lambda *of: asked.append(of[3]))
    stand_in("begin_balanced", lambda *_: asked.append("balance") or [])
    search.most = 3
    search_all(search, Explanation(nominal), lambda _: None)
    assert asked == [*expected, *([] if expected else ["balance"])]


def test_kinds_of_a_sensors_fault_are_compared_up_to_the_one_that_was_found(monkeypatch):
    refitted = []
    nominal, delay = attempt([], 1.1), attempt(["sensor_delay"], 1.0)
    kinds = [SimpleNamespace(name=f"sensor_{kind}") for kind in ("resonance", "delay", "gain")]
    monkeypatch.setattr(scrutiny, "kinds", lambda *_: [(kind, np.ones(1), 1.0) for kind in kinds])
    monkeypatch.setattr(scrutiny, "beside", lambda base, held, values: (held, values))
    nominal.followers, nominal.scale = [], 1.0
    search = SimpleNamespace(late=lambda: False, refit=lambda _, held, *more: refitted.append(held[0].name))
    for channel, expected in ((None, []), ("rod_c_axial", ["sensor_resonance"])):
        delay.hypotheses[0].channel = channel
        _compare_kinds(search, Explanation(nominal, [delay]), nominal)
        assert refitted == expected


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
    search.most = 3
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


@pytest.fixture
def fruitless(stand_in):
    """Every step finds nothing; returns ``stand_in``."""
    for name in (
        "glaring", "enlarge", "reshape", "reshape_anew", "begin_elsewhere", "begin_again", "begin_inside",
        "begin_clock", "begin_dimensions", "begin_displaced", "begin_wear", "begin_plausible", "widen",
        "fit_curve",
    ):  # fmt: skip
        stand_in(name, lambda *_, **__: None)
    for name in ("begin_balanced", "begin_pairs"):
        stand_in(name, lambda *_: [])
    stand_in("suggest_channels", lambda _: {})
    stand_in("suggest_dimensions", lambda *_: [])
    stand_in("suggest_curve", lambda *_: ([], np.inf))
    prospects = Prospects([], [], [], [], [])
    stand_in("look", lambda *_: prospects)
    return stand_in


@pytest.mark.parametrize(
    ("misfit", "best", "rails", "expected"),
    [
        (700.0, 700.0, None, True),
        (700.0, 43.0, None, True),  # one of two, perhaps
        (700.0, 3.0, None, False),  # nearly: a look tells what is missing
        (15.0, 15.0, None, False),
        (700.0, 43.0, "rails", False),  # measured: a slider that is loose is followed otherwise
    ],
)
def test_patience_is_for_what_nothing_follows(fruitless, misfit, best, rails, expected):
    asked = []
    fruitless("begin_patiently", lambda *_: asked.append("patience"))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False, most=1)
    name = "guide_clearance" if rails else "rod_flexibility"
    attempts = [attempt([name], best)] if best < misfit else []
    search_all(search, Explanation(attempt([], misfit), attempts, rails=rails), lambda _: None)
    assert bool(asked) == expected


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


@pytest.mark.parametrize(
    ("misfit", "found", "order"),
    [
        (10.0, [], ["balance", "names", "curve"]),
        (2.5, [], ["names", "curve", "balance"]),
        (3.9, [attempt(["gravity"], 1.7)], ["names", "balance", "curve"]),  # it may be one of two
    ],
)
def test_beside_a_far_path_the_balance_of_work_comes_first_beside_a_near_one_plain_names_then_curves(
    fruitless, misfit, found, order
):
    asked = []
    fruitless("begin_balanced", lambda *_: asked.append("balance") or [])
    fruitless("widen", lambda *_: asked.append("names"))
    fruitless("suggest_curve", lambda *_: asked.append("curve") or ([], np.inf))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False)
    for one in found:
        one.fit.values = np.zeros((1, 3))
    search.most = 3
    search_all(search, Explanation(attempt([], misfit), list(found)), lambda _: None)
    assert asked.count("balance") == asked.count("curve") == 1
    assert list(dict.fromkeys(asked)) == order


def test_what_promises_most_comes_before_the_balance_of_work_and_no_dimension_is_tried_twice(fruitless):
    asked = []
    tried, other = [
        SimpleNamespace(hypothesis=SimpleNamespace(name=name, fault=None), share=0.5)
        for name in ("slider_offset", "second_clearance")
    ]
    hint = SimpleNamespace(hypotheses=(SimpleNamespace(name="gravity", fault=None, channel=None),))
    fruitless("look", lambda *_: Prospects([hint], [], [], [], []))
    fruitless("widen", lambda *of: asked.append("obvious") if of[3] == [hint] else None)
    fruitless("suggest_dimensions", lambda *_: [tried, other])
    fruitless("begin_displaced", lambda *_: asked.append("displaced") or tried)
    fruitless("begin_balanced", lambda *_: asked.append("balance") or [])
    fruitless(
        "begin_dimensions",
        lambda _, __, those, before: asked.append([one.hypothesis.name for one in those if one is before]),
    )
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False)
    search.most = 3
    search_all(search, Explanation(attempt([], 30.0)), lambda _: None)
    assert asked == ["obvious", "displaced", "balance", ["slider_offset"]]


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


@pytest.mark.parametrize(("misfit", "most", "expected"), [(3.4, 2, 3), (3.4, 1, 0), (5.0, 2, 0)])
def test_two_that_promise_much_together_come_before_tables(fruitless, misfit, most, expected):
    hints, asked = list(range(5)), []
    fruitless("look", lambda *_: Prospects([], [], [], [], [], hints))
    fruitless("suggest_curve", lambda *_: asked.append("curve") or ([], np.inf))
    search = SimpleNamespace(
        recordings=[SimpleNamespace(channels=())], late=lambda: False, most=most,
        follow=lambda explanation, base, hint: asked.append(hint),
    )  # fmt: skip
    search_all(search, Explanation(attempt([], misfit)), lambda _: None)
    assert asked == [*hints[:expected], "curve"]


@pytest.mark.parametrize(
    ("hinted", "unpushed", "expected"),
    [("worn_bearing", False, ["wear"]), ("gravity", True, ["wear"]), ("gravity", False, [])],
)
def test_lobes_are_read_off_the_motion_where_a_look_promises_them_or_no_force_helps(
    stand_in, hinted, unpushed, expected
):
    asked = []
    hint = SimpleNamespace(hypotheses=(SimpleNamespace(name=hinted, fault=None),))
    prospects = Prospects([], [hint], [], [], [])
    stand_in("look", lambda *_: prospects)
    stand_in("glaring", lambda _: None)
    for name in ("suggest_channels", "suggest_dimensions"):
        stand_in(name, lambda *_: {})
    stand_in("settled", lambda *_: False)
    for name in ("balanced", "dimensions", "inside", "plausible"):
        stand_in(f"begin_{name}", lambda *_: [])
    stand_in("widen", lambda *_: None)
    stand_in("begin_wear", lambda *_: asked.append("wear"))
    search = SimpleNamespace(
        recordings=[SimpleNamespace(channels=("rod_b_axial",))], late=lambda: len(asked) > 0
    )
    stand_in("fit_curve", lambda *_: None)
    stand_in("suggest_curve", lambda *_: asked.append("curve") or ([], np.inf))
    stand_in("begin_elsewhere", lambda *_: None)
    nominal = attempt([], 10.0)
    search.most = 3
    search_all(search, Explanation(nominal, unpushed=unpushed), lambda _: None)
    assert asked == (expected or ["curve"])


@pytest.mark.parametrize(
    ("misfit", "seen", "expected"),
    [
        (30.0, False, ["rails", "balance", "guide"]),
        (30.0, True, ["rails", "balance"]),
        (10.0, False, ["guide"]),
    ],
)
def test_rails_beyond_doubt_come_before_any_force_and_are_not_followed_twice(
    fruitless, misfit, seen, expected
):
    def guide(search, explanation, most=1.0):
        asked.append("guide" if most == 1.0 else "rails")
        return seen

    asked = []
    fruitless("begin_guide", guide)
    fruitless("begin_balanced", lambda *_: asked.append("balance") or [])
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False)
    search.most = 1
    search_all(search, Explanation(attempt([], misfit)), lambda _: None)
    assert [one for one in asked if misfit > 20.0 or one != "balance"] == expected


@pytest.mark.parametrize(("name", "forces"), [("soft_drive", True), ("guide_clearance", False)])
def test_between_rails_a_part_counts_as_a_force_unless_it_is_these_rails(fruitless, name, forces):
    """Play beside play in the same guide took three minutes, and hid what one alone explains."""
    part, asked = attempt([name], 5.0), []
    part.fit.values, part.model.shared = np.array([[3e-4, 7.0, 70.0]]), 2
    fruitless("begin_guide", lambda search, explanation, *given, most=1.0: asked.append(given) or False)
    fruitless("unfinished", lambda *_: part)
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False)
    search.most = 2
    course = Course(search, Explanation(attempt([], 10.0), [part]))
    course.built_on.append(part)
    course.motion()
    assert [given[1:2] for given in asked] == [(part.hypotheses,) if forces else ()]


@pytest.mark.parametrize(
    ("name", "fault", "channel", "beside"),
    [
        ("timebase", True, "rod_b_axial", True),
        ("second_clearance", None, "slider_vertical", True),
        ("second_clearance", None, "rod_c_axial", False),  # play in the other joint can look like rails
        ("sensor_gain", True, "slider_vertical", False),
    ],
)
def test_rails_are_looked_for_by_the_clock_or_dimension_that_the_motion_accuses(
    fruitless, name, fault, channel, beside
):
    def guide(search, explanation, shown=None, most=1.0):
        asked.append(shown)
        return shown is not None

    asked, accused = [], SimpleNamespace(hypothesis=SimpleNamespace(name=name, fault=fault), share=0.4)
    fruitless("begin_guide", guide)
    fruitless("suggest_dimensions", lambda *_: [accused])
    fruitless("Shown", SimpleNamespace(alone=lambda search, one: one))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=(channel,))], late=lambda: False)
    search.most = 2
    explanation = Explanation(attempt([], 30.0))
    search_all(search, explanation, lambda _: None)
    assert explanation.misplaced == (0.4 if name == "second_clearance" else np.inf)
    assert asked == ([None, accused] if beside else [None, None])  # again, where rails were not found
