"""What is asked of an explanation once one is found."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.strategy import find_explanation
from tests.diagnosis.attempts import attempt


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (attempt(["worn_bearing"], 1.31), ["worn_bearing"]),  # a rod that bends was missing, too
        (attempt(["worn_bearing"], 1.08), []),
        (attempt(["worn_bearing", "gravity", "soft_drive"], 1.31), []),  # no more may be missing
        (attempt([FREE_FORM], 1.31), []),
    ],
)
def test_effects_that_explain_less_than_right_ones_are_looked_beside(monkeypatch, found, expected):
    strategy = "clearance.diagnosis.searching.strategy."
    for name in (
        "begin_shaking", "search_all", "choose_argument", "enlarge", "sharpen", "scrutinise", "retry_nominal",
        "contest", "confirm", "prune",
    ):  # fmt: skip
        monkeypatch.setattr(strategy + name, lambda *_, **__: None)
    beside, inside = [], []
    for name, asked in (("elsewhere", beside), ("inside", inside)):
        monkeypatch.setattr(
            strategy + f"begin_{name}",
            lambda _, __, base, asked=asked, anew=True: asked.extend(h.name for h in base.hypotheses),
        )
    search = SimpleNamespace(late=lambda: False)
    search.most = 3
    find_explanation(search, Explanation(attempt([], 40.0), [found]), lambda _: None)
    assert beside == inside == expected


def test_beside_one_of_two_what_acts_inside_the_joint_is_asked(monkeypatch):
    strategy, inside = "clearance.diagnosis.searching.strategy.", []
    for name in (
        "begin_shaking", "search_all", "choose_argument", "enlarge", "sharpen", "scrutinise", "retry_nominal",
        "contest", "confirm", "prune", "begin_elsewhere",
    ):  # fmt: skip
        monkeypatch.setattr(strategy + name, lambda *_, **__: None)
    monkeypatch.setattr(strategy + "begin_inside", lambda _, __, base, anew: inside.append(base))
    one, two = attempt(["sensor_bias"], 1.28), attempt(["sensor_bias", "sensor_gain"], 1.21)
    find_explanation(
        SimpleNamespace(late=lambda: False, most=2), Explanation(attempt([], 8.8), [one, two]), lambda _: None
    )
    assert inside == [one]  # the gain had taken a little of what a softer contact does


@pytest.mark.parametrize("alone", [True, False])
def test_a_name_that_explains_alone_once_another_is_pruned_stands_against_a_table_too(monkeypatch, alone):
    strategy, contested = "clearance.diagnosis.searching.strategy.", []
    for name in (
        "begin_shaking", "search_all", "choose_argument", "enlarge", "sharpen", "scrutinise", "retry_nominal",
        "confirm", "begin_elsewhere", "begin_inside",
    ):  # fmt: skip
        monkeypatch.setattr(strategy + name, lambda *_, **__: None)
    pair, one = attempt(["gravity", "restitution"], 1.0), attempt(["gravity"], 1.0)

    def prune(search, explanation):
        explanation.attempts += [one] if alone else []

    monkeypatch.setattr(strategy + "prune", prune)
    monkeypatch.setattr(strategy + "contest", lambda _, explanation: contested.append(explanation.best))
    search = SimpleNamespace(late=lambda: False, most=2)
    find_explanation(search, Explanation(attempt([], 40.0), [pair]), lambda _: None)
    assert contested == ([pair, one] if alone else [pair])


@pytest.mark.parametrize(("left", "asked"), [(1.29, True), (1.05, False)])
def test_names_that_leave_more_than_right_ones_may_be_none_of_what_is_missing(monkeypatch, left, asked):
    """Lobes and another stiffness left 1.29 of what a rod that bends explained."""
    strategy, bases = "clearance.diagnosis.searching.strategy.", []
    for name in (
        "begin_shaking", "search_all", "choose_argument", "enlarge", "sharpen", "scrutinise", "retry_nominal",
        "confirm", "contest", "prune", "begin_inside", "place_edges", "begin_sure",
    ):  # fmt: skip
        monkeypatch.setattr(strategy + name, lambda *_, **__: None)
    monkeypatch.setattr(strategy + "begin_elsewhere", lambda _, __, base: bases.append(base))
    nominal, pair = attempt([], 1.55), attempt(["worn_bearing", "contact_stiffness"], left)
    search = SimpleNamespace(late=lambda: False, most=2)
    find_explanation(search, Explanation(nominal, [pair]), lambda _: None)
    assert bases == ([nominal] if asked else [])


@pytest.mark.parametrize(
    ("misfit", "closed", "asked"), [(1.28, True, True), (1.28, False, False), (1.1, True, False)]
)
def test_a_nominal_machine_that_explains_with_its_gap_closed_is_asked_for_a_film(
    monkeypatch, misfit, closed, asked
):
    """By 5 % of noise a film of 90 um left 1.28 of a joint without play, and was told as a rod that bends."""
    strategy, bases = "clearance.diagnosis.searching.strategy.", []
    for name in (
        "begin_shaking", "scrutinise", "retry_nominal", "contest", "confirm", "prune", "begin_elsewhere",
        "begin_sure", "begin_small_force",
    ):  # fmt: skip
        monkeypatch.setattr(strategy + name, lambda *_, **__: None)
    monkeypatch.setattr(strategy + "begin_inside", lambda _, __, base: bases.append(base))
    nominal = attempt([], misfit)
    nominal.fit.values = np.array([[5e-6 if closed else 8e-5, 700.0]])
    search = SimpleNamespace(late=lambda: False, most=2)
    find_explanation(search, Explanation(nominal, agreed=("C", 9e-5)), lambda _: None)
    assert bases == ([nominal] if asked else [])


@pytest.mark.parametrize("right", [True, False])
def test_what_a_look_was_sure_of_is_followed_before_what_takes_longer_and_once(monkeypatch, right):
    """A contact of a third of the stiffness hid behind friction in the joint, which left 1.31 of 1.33."""
    strategy, asked = "clearance.diagnosis.searching.strategy.", []
    for name in (
        "begin_shaking", "search_all", "choose_argument", "enlarge", "sharpen", "scrutinise", "retry_nominal",
        "confirm", "contest", "prune", "begin_inside", "place_edges", "begin_small_force",
    ):  # fmt: skip
        monkeypatch.setattr(strategy + name, lambda *_, **__: None)

    def sure(_, explanation):
        asked.append("sure")
        explanation.attempts += [attempt(["contact_stiffness"], 0.98)] if right else []

    monkeypatch.setattr(strategy + "begin_sure", sure)
    monkeypatch.setattr(strategy + "begin_elsewhere", lambda *_: asked.append("elsewhere"))
    search = SimpleNamespace(late=lambda: False, most=2)
    explanation = Explanation(attempt([], 1.33), [attempt(["joint_friction"], 1.31)])
    find_explanation(search, explanation, lambda _: None)
    assert asked[0] == "sure"
    assert asked.count("sure") == 1
    assert ("elsewhere" in asked) == (not right)
