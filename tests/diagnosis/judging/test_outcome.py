"""What is expected of recordings that were held out."""

import pytest

from clearance.diagnosis.judging.outcome import _passing
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.slider_crank import SliderCrank


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"argument": "time", "spacing": 0.1}, True),
        ({"argument": "time", "period": 0.2}, False),  # goes on by its clock
        ({"argument": "slider_position", "spacing": 0.1}, False),
    ],
)
def test_only_a_force_over_one_recordings_time_says_nothing_of_another(table, expected):
    assert _passing(SliderCrank(force=TabulatedForce(values=(1.0, 2.0, 3.0), **table))) == expected


def test_a_machine_without_a_table_is_looked_for_in_every_recording():
    assert not _passing(SliderCrank())
