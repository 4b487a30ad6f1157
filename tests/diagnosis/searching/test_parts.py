"""Which attempt is built on, and when one is enough."""

import pytest

from clearance.diagnosis.following.attempt import explained
from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.searching.beside import SHARED
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.parts import PART, enough, in_part, named, set_aside, unfinished
from tests.diagnosis.attempts import attempt


@pytest.mark.parametrize(
    ("nominal", "misfit", "finer", "expected"),
    [
        (200.0, 1.2, None, True), (200.0, 3.0, None, True), (200.0, 15.0, None, False),
        (8.0, 3.0, None, False),
        (200.0, 3.0, 3.4, False),  # more knots do not help: it is no matter of its shape
        (200.0, 3.0, 2.0, True), (200.0, 3.0, 2.9, False),
    ],
)  # fmt: skip
def test_a_table_ends_the_search_where_only_its_shape_can_be_missing(nominal, misfit, finer, expected):
    tables = [attempt(["free_form"], one) for one in (misfit, finer) if one is not None]
    for knots, table in zip((6, 12), tables, strict=False):
        table.label, table.model.shared = "free_form(crank torque)", 1 + knots
    assert enough(Explanation(attempt([], nominal), tables)) == expected


@pytest.mark.parametrize(
    ("names", "misfit", "part", "expected"),
    [
        (["slider_offset"], 10.1, PART, True),  # a rod that bends was missing beside it
        (["slider_offset"], 14.0, PART, False),
        (["slider_offset"], 14.0, SHARED, True),
        (["rod_inertia"], 10.1, PART, False),
        (["rod_inertia"], 7.0, PART, True),
        (["rod_inertia"], 8.2, PART, True),  # noise leaves 1.0 in any case
        (["rod_inertia"], 1.1, PART, False),  # nothing is left
        (["joint_lubrication"], 13.0, SHARED, True),  # a drive that gives way was missing beside it
        (["joint_lubrication"], 17.0, SHARED, False),
        ([FREE_FORM], 7.0, PART, False),
        ([], 7.0, PART, False),
    ],
)
def test_a_good_part_of_what_is_missing_is_built_on(names, misfit, part, expected):
    nominal = attempt([], 25.2)
    assert in_part(Explanation(nominal), attempt(names, misfit), nominal, part) == expected


@pytest.mark.parametrize(("misfit", "first"), [(1.8, "soft_drive"), (1.02, "soft_drive + rod_inertia")])
def test_two_effects_that_do_not_explain_keep_nobody_from_looking_beside_the_first(misfit, first):
    drive, pair = attempt(["soft_drive"], 2.7), attempt(["soft_drive", "rod_inertia"], misfit)
    explanation = Explanation(attempt([], 37.8), [drive, pair])
    assert unfinished(explanation, 2) is drive
    assert unfinished(explanation, 3) is pair
    assert explanation.best is pair
    with set_aside(explanation, 2):
        assert explanation.best.label == first
    assert explanation.best is pair


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (147.0, "torque_ripple"),  # a frame that gives way was missing beside it
        (40.0, FREE_FORM),
        (400.0, "torque_ripple"),
    ],
)
def test_a_table_that_leaves_much_is_not_built_on(table, expected):
    attempts = [attempt(["torque_ripple"], 305.0), attempt([FREE_FORM], table), attempt(["gravity"], 350.0)]
    found = named(Explanation(attempt([], 1450.0), attempts))
    assert [h.name for h in found.hypotheses] == [expected]


@pytest.mark.parametrize(
    ("name", "finer", "expected"),
    [
        (43.0, 8.2, "process_load"),
        (43.0, 9.1, "process_load"),
        (43.0, None, FREE_FORM),
        (90.0, 8.2, FREE_FORM),
        (43.0, 1.1, FREE_FORM),
    ],
)
def test_a_name_is_built_on_where_no_finer_table_explains_what_it_leaves(name, finer, expected):
    tables = [attempt([FREE_FORM], one) for one in (8.5, finer) if one is not None]
    for knots, table in zip((12, 23), tables, strict=False):
        table.label, table.model.shared = "free_form(slider x)", 1 + knots
    found = named(Explanation(attempt([], 689.0), [attempt(["process_load"], name), *tables]))
    assert [h.name for h in found.hypotheses] == [expected]


@pytest.mark.parametrize(("last", "enough_said"), [(1.9, True), (2.1, False), (1e4, False)])
def test_one_recording_that_is_lost_among_many_is_not_explained(last, enough_said):
    """However little it weighs in the mean of all."""
    assert explained(attempt(["gravity"], 1.0, each=[1.0] * 9 + [last])) == enough_said
