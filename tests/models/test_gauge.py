import json
from dataclasses import replace

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.models.gauge import Gauge
from clearance.models.interval import robust_mean
from clearance.recording.chain import chain_differences, declared_chain
from tests.models.conftest import configured


@pytest.fixture
def trained(make_data, open_run):
    data = make_data(runs=60, samples=600)
    estimator = configured("xgboost")
    estimator.fit(data, open_run())
    return Gauge.calibrate(estimator, data, coverage=0.8, false_rejection=0.05, limit=1e-3), data


def test_a_saved_gauge_reads_the_same(trained, tmp_path, chirps):
    gauge, _ = trained
    gauge.save(tmp_path)
    again = Gauge.load(configured("xgboost"), tmp_path)
    fresh = chirps(5, 600, seed=9).load(("a", "b"), ("clearance_c",), 2**30)
    for index in range(5):
        (one,) = gauge.estimate(fresh.recording(index), 1e4)
        assert again.estimate(fresh.recording(index), 1e4) == (one,)
        assert (one.joint, one.has_clearance) == ("C", None)
        assert one.low_m <= one.clearance_m <= one.high_m
        assert one.windows == 10


def test_a_gauge_of_larger_clearances_than_the_configured_reaches_as_far_as_its_data(make_data, open_run):
    data = make_data(runs=20, samples=600)
    estimator = configured("xgboost")
    estimator.fit(data, open_run())
    gauge = Gauge.calibrate(estimator, data, coverage=0.9, false_rejection=0.05, limit=2e-4)
    assert gauge.intervals[0].quantiles[-1] is None  # three recordings support no 90 %
    largest = int(np.argmax(data.recordings.target))
    scaler = data.scalers.signals
    raw = data.recordings.recording(largest) * np.array(scaler.deviation) + np.array(scaler.mean)
    (one,) = gauge.estimate(raw, 1e4)
    assert one.clearance_m > 2e-4
    assert (one.low_m, one.high_m) == (0.0, max(data.recordings.target.max(), one.clearance_m))


def test_recordings_of_few_machines_promise_no_more_than_these(trained, monkeypatch):
    gauge, data = trained
    said: list[str] = []
    monkeypatch.setattr("clearance.models.gauge.log.warning", lambda text, *of: said.append(text % of))
    tests = len(data.parts.test)
    wanted = {"coverage": 0.8, "false_rejection": 0.05, "limit": 1e-3}
    apart = Gauge.calibrate(gauge.estimator, data, **wanted)
    assert apart.intervals[0].quantiles[-1] is not None
    assert said == []
    groups = data.recordings.groups.copy()
    try:
        data.recordings.groups[np.sort(data.parts.test)] = 1000 + np.arange(tests) % 3
        found = Gauge.calibrate(gauge.estimator, data, **wanted)
        assert found.intervals[0].quantiles[-1] is None  # three machines support 75 %
        assert found.familiarity.false_rejection == 0.25
        assert len(said) == 1
        assert f"{tests} recordings of 3 machines are too few" in said[0]
        assert "calibration.coverage=0.75" in said[0]
        lower = Gauge.calibrate(gauge.estimator, data, **{**wanted, "coverage": 0.75})
        assert lower.intervals[0].quantiles[-1] is not None
    finally:
        data.recordings.groups[:] = groups


def test_a_recording_is_scaled_as_in_training(trained):
    gauge, data = trained
    index = int(data.parts.test[0])
    scaled = data.recordings.recording(index)
    scaler = data.scalers.signals
    raw = scaled * np.array(scaler.deviation) + np.array(scaler.mean)
    windows = data.test_windows()
    expected = data.scalers.target.inverse(gauge.estimator.predict(windows))[
        windows.recording.numpy() == index
    ]
    # Scaling back and forth costs the last bits of single precision, which may move a sample past a split.
    found = gauge.estimate(raw, 1e4)[0]
    assert found.clearance_m == pytest.approx(max(robust_mean(expected[:, 0]), 0.0), rel=0.01, abs=2e-6)
    assert found.spread_m == pytest.approx(
        1.4826 * np.median(np.abs(expected - np.median(expected))), rel=0.2, abs=1e-6
    )


def test_of_a_chain_that_is_not_declared_nothing_is_claimed(trained):
    gauge, data = trained
    recording, usual = data.recordings.recording(0), declared_chain(None)
    assert "chain" not in gauge.estimate(recording, 1e4)[0].reason
    other = replace(gauge, chain={**usual, "base_rate": 256e3})
    (silent,), (declared,) = (other.estimate(recording, 1e4, chain) for chain in (None, usual))
    assert not silent.trusted
    assert silent.reason.startswith(
        "its chain is not declared, the model was trained with chain.base_rate = 256000.0; give chain: in"
    )
    assert declared.reason.startswith("recorded with chain.base_rate = 100000.0")


def test_a_chain_that_is_not_declared_ends_at_the_recording_s_rate():
    assert declared_chain(None) == declared_chain(None, 10005.0)  # what clocks differ by
    assert declared_chain(None, 2e4)["decimation"] == 5
    assert declared_chain({"decimation": 20}, 1e4)["base_rate"] == 2e5
    assert declared_chain({"base_rate": 1e6}, 1e4)["decimation"] == 100
    assert not chain_differences({"base_rate": 1e5, "decimation": 5}, declared_chain(None, 2e4), 2e4)


@pytest.mark.parametrize(
    ("signals", "rate", "words"),
    [
        (np.zeros((600, 2)), 5e3, "5000 Hz"),
        (np.zeros((59, 2)), 1e4, "59 samples: at least 60"),
        (np.full((600, 2), np.nan), 1e4, "NaN"),
        (np.full((600, 2), -1e300), 1e4, r": -1e\+300, in sample 0, is larger than any model reads"),
    ],
)
def test_an_unusable_recording_is_refused(trained, signals, rate, words):
    with pytest.raises(InputError, match=words):
        trained[0].estimate(signals, rate)


def test_a_damaged_calibration_is_refused(trained, tmp_path):
    trained[0].save(tmp_path)
    content = json.loads((tmp_path / "calibration.json").read_text())
    del content["intervals"][0]["floor"]
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="set checkpoint"):
        Gauge.load(configured("xgboost"), tmp_path)
