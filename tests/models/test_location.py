"""Where clearance is: the threshold that separates best, and what is reported of it."""

import numpy as np
import pytest

from clearance.evaluation.evaluate import evaluate
from clearance.evaluation.metrics import paper_metrics
from clearance.models.gauge import Gauge
from clearance.models.location import LOCATIONS, choose_threshold, location

BOTH = ("clearance_b", "clearance_c")


@pytest.mark.parametrize(
    ("tight", "loose", "expected"),
    [
        ([0.0, 1e-5], [9e-5, 2e-4], 5e-5),  # between the two kinds
        ([0.0, 1e-5, 1.1e-4], [9e-5, 2e-4, 3e-4, 4e-4], 1.55e-4),  # 1 and 3/4 against 2/3 and 1
        ([0.0, 1e-5, 2e-5, 1.1e-4], [9e-5, 2e-4], 5.5e-5),  # 3/4 and 1 against 1 and 1/2
        ([0.0] * 9 + [6e-5], [4e-5], 2e-5),  # nine times as many of a kind count as much as one of the other
        ([], [2e-4, 3e-4], 1e-4),  # all of one kind
        ([0.0, 2e-4], [], 6e-4),
        ([0.0, 3e-4], [1e-4, 4e-4], 5e-5),  # 1/2 and 1, as good as 1 and 1/2: the lower of two
        ([0.0, 3e-4, 5e-4], [1e-4, 4e-4, 6e-4], 3.5e-4),  # 1/3 and 1, 2/3 and 2/3, 1 and 1/3: the middle
    ],
)
def test_the_threshold_has_the_largest_balanced_accuracy_and_lies_in_the_middle(tight, loose, expected):
    estimates = np.array([*tight, *loose])
    kinds = np.array([False] * len(tight) + [True] * len(loose))
    assert choose_threshold(estimates, kinds, 1e-3) == pytest.approx(expected)


def test_a_location_is_named_by_the_joints_that_have_clearance():
    joints = [(False, False), (True, False), (False, True), (True, True)]
    assert [LOCATIONS[place] for place in location(joints)] == ["neither", "B", "C", "both"]


class Knowing:
    """Gives the true clearances of the windows, and of B too little by 0.1 mm."""

    def predict(self, windows):
        return windows.target.double().numpy() - np.array([0.1, 0.0])


class Mistaken:
    """Gives the true clearances of the windows; of some recordings too much by a tenth of the range."""

    def __init__(self, recordings):
        self.recordings = recordings

    def predict(self, windows):
        off = np.isin(windows.recording.numpy(), self.recordings)
        return windows.target.double().numpy() + 0.1 * off[:, None]


def test_intervals_are_of_the_test_recordings_floor_and_thresholds_of_the_validation_ones(make_data):
    data = make_data(runs=60, targets=BOTH)
    exact, on_validation, on_test = (
        Gauge.calibrate(Mistaken(part), data, 0.8, 0.05, 1e-3)
        for part in ([], data.parts.validation, data.parts.test)
    )
    off = 0.1 * np.subtract(data.scalers.target.high, data.scalers.target.low)
    assert [one.floor for one in on_validation.intervals] == pytest.approx(off, rel=1e-3)
    assert [one.quantiles[-1] for one in on_validation.intervals] == pytest.approx([0.0, 0.0], abs=1e-3)
    assert on_validation.thresholds != exact.thresholds
    assert [one.floor for one in on_test.intervals] == [1e-9, 1e-9]  # the least
    assert [1e-9 * one.quantiles[-1] for one in on_test.intervals] == pytest.approx(off, rel=1e-3)
    assert on_test.thresholds == exact.thresholds


def test_limits_of_trust_are_of_the_test_recordings_and_what_is_familiar_of_the_training_ones(
    make_data, chirps
):
    def louder(side):
        source = chirps(60)
        source.spoil = lambda recordings, parts: [
            np.multiply(one, 3.0, out=one) for one in map(recordings.recording, getattr(parts, side))
        ]
        return Gauge.calibrate(Mistaken([]), make_data(source=source), 0.8, 0.05, 1e-3).familiarity

    plain, other = louder("validation"), louder("test")
    assert np.array_equal(plain.references, other.references)
    assert min(other.limits) > max(plain.limits)


def test_shares_and_errors_are_those_of_the_recordings(make_data):
    data = make_data(runs=60, targets=BOTH)
    gauge = Gauge.calibrate(Knowing(), data, 0.8, 0.05, 1e-3)
    assert gauge.joints == ("B", "C")
    true = data.recordings.target[data.parts.test]
    off = 100 * 0.1 * data.scalers.target.high[0] / 1e-3  # percent
    said = true - [off * 1e-5, 0.0] > gauge.thresholds
    right = (said == (true > 0)).all(axis=1)
    found = evaluate(gauge, data, data.test_windows(), paper_metrics())
    whole = 1e5 * np.minimum(true[:, 0], off * 1e-5).mean()  # of a recording no clearance is said below zero
    for prefix, expected in (("", off), ("recording_", whole)):
        errors = [found.metrics[f"{prefix}nmae{end}"] for end in ("", "_b", "_c")]
        assert errors == pytest.approx([expected / 2, expected, 0.0], rel=1e-5, abs=1e-5)
    assert found.metrics["location_accuracy"] == np.mean(right)
    sure = [all(clearance == 0 or clearance > 5e-5 for clearance in pair) for pair in true]
    assert found.metrics["location_accuracy_above_50_um"] == np.mean(right[sure])
    for axis, loose in ((1, true > 0), (0, said)):
        places = loose[:, 0] + 2 * loose[:, 1]
        assert found.locations.sum(axis=axis).tolist() == np.bincount(places, minlength=4).tolist()
    assert set(found.figures("test")) == {
        "predicted_against_true_b", "error_b", "predicted_against_true_c", "error_c", "location",
    }  # fmt: skip
    drawn = found.figures("test")["location"].axes[0]
    assert [text.get_text() for text in drawn.texts] == [str(count) for count in found.locations.ravel()]


def test_a_saved_gauge_tells_the_same_joints(make_data, tmp_path):
    data = make_data(runs=40, targets=BOTH)
    knowing = Knowing()
    knowing.save = knowing.load = lambda folder: None
    gauge = Gauge.calibrate(knowing, data, 0.8, 0.05, 1e-3)
    gauge.save(tmp_path)
    again = Gauge.load(knowing, tmp_path)
    assert (again.targets, again.thresholds, again.intervals) == (
        gauge.targets, gauge.thresholds, gauge.intervals,
    )  # fmt: skip
    low, high = np.array(gauge.thresholds) - 1e-6, np.array(gauge.thresholds) + 1e-6
    assert again.loose(np.stack([low, high])).tolist() == [[False, False], [True, True]]
