"""In which order steps are tried, and when the search goes on."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching.course import search_all
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.widen import Prospects
from tests.diagnosis.attempts import attempt

pytestmark = pytest.mark.usefixtures("still")


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
        SimpleNamespace(hypothesis=SimpleNamespace(name=name, fault=None, channel=None), share=0.5)
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


@pytest.mark.parametrize(
    ("channel", "share", "most", "expected"),
    [
        ("slider_horizontal", 0.1, 2, ["force", "displaced"]),
        ("slider_horizontal", 0.1, 1, ["displaced"]),
        ("slider_horizontal", 0.6, 2, ["displaced"]),
        (None, 0.1, 2, ["displaced"]),  # a clock that is wrong is every channel's
    ],
)
def test_beside_a_sensor_s_fault_that_the_motion_shows_a_force_is_asked_for(
    fruitless, channel, share, most, expected
):
    asked, fault = [], SimpleNamespace(name="gain", fault="gain", channel=channel)
    shown = SimpleNamespace(hypothesis=fault, share=share)
    fruitless("suggest_dimensions", lambda *_: [shown])
    fruitless("begin_misheard", lambda _, __, one: asked.append("force" if one is shown else one))
    fruitless("begin_displaced", lambda *_: asked.append("displaced"))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False, most=most)
    search_all(search, Explanation(attempt([], 90.0)), lambda _: None)
    assert asked == expected


@pytest.mark.parametrize(
    ("misfit", "share", "expected"),
    [
        (1.8, 0.085, ["curve", "elsewhere", "balance"]),  # a rod that bends: lobes and names took 300 s
        (1.8, 0.2, ["curve", "balance", "elsewhere"]),
        (
            30.0,
            0.01,
            ["balance", "curve", "elsewhere"],
        ),  # beside a far path a look promises nothing of what is right
    ],
)
def test_where_a_near_path_promises_next_to_nothing_what_no_look_judges_comes_before_names(
    fruitless, misfit, share, expected
):
    asked = []
    fruitless("look", lambda *_: Prospects([], [], [], [], [], share=share))
    fruitless("begin_balanced", lambda *_: asked.append("balance") or [])
    fruitless("suggest_curve", lambda *_: asked.append("curve") or ([], np.inf))
    fruitless("begin_elsewhere", lambda *_: asked.append("elsewhere"))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: False, most=2)
    search_all(search, Explanation(attempt([], misfit)), lambda _: None)
    assert asked == expected


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

    hypothesis = SimpleNamespace(name=name, fault=fault, channel=None)
    asked, accused = [], SimpleNamespace(hypothesis=hypothesis, share=0.4)
    fruitless("begin_guide", guide)
    fruitless("suggest_dimensions", lambda *_: [accused])
    fruitless("Shown", SimpleNamespace(alone=lambda search, one: one))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=(channel,))], late=lambda: False)
    search.most = 2
    explanation = Explanation(attempt([], 30.0))
    search_all(search, explanation, lambda _: None)
    assert explanation.misplaced == (0.4 if name == "second_clearance" else np.inf)
    assert asked == ([None, accused] if beside else [None, None])  # again, where rails were not found
