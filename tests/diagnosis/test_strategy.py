"""In which order explanations are tried, and when the search goes on."""

from types import SimpleNamespace

import pytest

from clearance.diagnosis.explain import Explanation
from clearance.diagnosis.strategy import _enough
from clearance.diagnosis.verdict import unsettled
from tests.diagnosis.test_verdict import attempt


@pytest.mark.parametrize(
    ("nominal", "gain", "small", "expected"),
    [
        (1.02, 10.0, [], False),  # nothing is missing
        (1.02, 200.0, [], True),
        (1.19, 200.0, [1.18], True),  # a second clearance was taken for a heavier rod
        (1.19, 200.0, [1.01], False),
        (50.0, 200.0, [1.30], False),
    ],
)
def test_something_small_that_leaves_most_does_not_end_the_search(nominal, gain, small, expected):
    attempts = [attempt(["rod_inertia"], misfit) for misfit in small]
    explanation = Explanation(attempt([], nominal), attempts, [SimpleNamespace(gain=gain)])
    assert unsettled(explanation) == expected


@pytest.mark.parametrize(("misfit", "expected"), [(1.2, True), (3.0, True), (15.0, False)])
def test_a_table_ends_the_search_where_only_its_shape_can_be_missing(misfit, expected):
    assert _enough(Explanation(attempt([], 200.0), [attempt(["free_form"], misfit)])) == expected
