"""How the time of a diagnosis is shared out, and what is refused before any is spent."""

from math import inf

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging import outcome
from clearance.diagnosis.judging.outcome import diagnose, patience
from clearance.diagnosis.sensing.measured import Measured
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.recording import Recording


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


def test_a_held_out_recording_of_something_else_is_refused_before_anything_is_fitted(monkeypatch):
    def noise(name):
        values = np.random.default_rng(1).normal(size=(4000, len(ACCELERATIONS)))
        return Measured.of(Recording(values, tuple(ACCELERATIONS), 1e4), MeasurementChain(), name)

    monkeypatch.setattr(outcome, "locate_joint", lambda *_: pytest.fail("something was fitted"))
    with pytest.raises(InputError, match=r"2\.csv: this mechanism explains \d+% of what it shows"):
        diagnose(
            [noise("1.csv")], [noise("2.csv")], [Setting(SliderCrank(), "C")], [], (50.0, 100.0), 1, 1, str
        )


def test_without_a_limit_they_are_looked_for_as_long_as_it_takes():
    assert patience(1e4, inf) == inf
