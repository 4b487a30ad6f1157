"""How the time of a diagnosis is shared out."""

from math import inf

import pytest

from clearance.diagnosis.judging.outcome import patience


@pytest.mark.parametrize(
    ("spent", "expected"),
    [
        (20.0, 60.0),  # a fifth of the limit at most
        (225.0, 45.0),  # up to nine tenths of it
        (290.0, 30.0),  # a tenth, however late it is
    ],
)
def test_lost_paths_are_looked_for_until_the_time_is_nearly_over(spent, expected):
    assert patience(spent, 300.0) == pytest.approx(expected)


def test_without_a_limit_they_are_looked_for_as_long_as_it_takes():
    assert patience(1e4, inf) == inf
