"""Whatever falls short is listed, a word each."""

import pytest

from clearance.trial.shortfalls import shortfalls

RIGHT = {
    "kind": "effect", "visible": True, "verdict": "physics", "why": None, "body_right": True,
    "direction_right": True, "curve_correlation": None, "held_out": {"after": 1.0, "floor": 1.0},
    "left_over": 0.2, "spurious": False, "named": ["gravity"], "rightly": ["gravity"],
    "parameters": [{"effect": "gravity", "parameter": "gravity_x", "covered": True}],
    "clearance": {"covered": True},
}  # fmt: skip
UNCOVERED = [{"effect": "gravity", "parameter": "gravity_x", "covered": False}]


def test_of_a_right_verdict_nothing_falls_short():
    assert shortfalls(RIGHT) == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"why": "named slider_spring instead"}, ["named slider_spring instead"]),
        ({"body_right": False, "direction_right": False}, ["on the wrong body"]),
        ({"direction_right": False}, ["in the wrong direction"]),
        ({"kind": "outside", "curve_correlation": 0.91}, ["a curve that correlates by 0.91"]),
        ({"kind": "outside", "curve_correlation": 0.0}, ["no curve"]),
        ({"held_out": {"after": 6.26, "floor": 1.0}}, ["a held-out error of 6.26 times the floor"]),
        (
            {"held_out": {"after": 1.0, "floor": 1.0, "shares": {"1.csv": 0.6}}},
            ["60% of a held-out recording followed"],
        ),
        ({"left_over": 2.0}, ["2.00 times the threshold left over"]),
        ({"spurious": True, "named": ["gravity", "timebase"]}, ["timebase asserted, not there"]),
        (
            {"parameters": UNCOVERED, "clearance": {"covered": False}},
            ["gravity.gravity_x and the clearance outside the interval"],
        ),
    ],
)
def test_each_thing_that_falls_short_has_its_word(changed, words):
    assert shortfalls(RIGHT | changed) == words


def test_what_is_too_small_to_be_seen_may_be_missed():
    missed = RIGHT | {"visible": False, "verdict": "none", "why": "missed below the threshold", "named": []}
    assert shortfalls(missed) == []
    assert shortfalls(missed | {"verdict": "physics", "why": "named timebase instead"}) != []


def test_a_case_without_a_verdict_has_no_other_numbers():
    assert shortfalls({"why": "no verdict within 600 s", "verdict": None}) == ["no verdict within 600 s"]
