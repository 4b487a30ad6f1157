import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clearance.errors import InputError
from clearance.models.interval import ConformalInterval, conformal_quantile, robust_mean, spread


def recordings(rng, count, windows=20):
    """Windows that share their recording's error; large clearances are less certain, as in the mechanism."""
    made = []
    for truth in rng.uniform(0, 1e-3, count):
        noise = 2e-6 + 0.02 * truth
        made.append((truth + rng.normal(0, noise) + rng.normal(0, 2 * noise, windows), truth))
    return made


@pytest.mark.parametrize("windows", [1, 5, 20])
def test_the_stated_share_of_intervals_holds_the_truth(windows):
    rng = np.random.default_rng(0)
    held, trials, fresh = 0, 100, 20
    for _ in range(trials):
        interval = ConformalInterval.calibrate(recordings(rng, 30), recordings(rng, 45), coverage=0.9)
        for estimates, truth in recordings(rng, fresh, windows):
            low, high = interval.bounds(estimates)
            held += low <= truth <= high
    share = held / (trials * fresh)
    # Theory: between 0.9 and 0.9 + 1/46. A recording of 5 windows uses the entry for 4, which is wider.
    # 100 calibrations scatter the mean by 0.042 / sqrt(100) = 0.0042: three of those.
    assert share > 0.9 - 0.0126
    assert share < (0.9 + 1 / 46 + 0.0126 if windows != 5 else 0.96)


def test_estimates_that_are_no_numbers_are_refused():
    known = recordings(np.random.default_rng(1), 3)
    with pytest.raises(InputError, match=r"no numbers.*lower trainer\.optimizer\.lr"):
        ConformalInterval.calibrate([*known, (np.full(20, np.nan), 1e-4)], known)


def test_too_few_recordings_give_the_whole_range():
    rng = np.random.default_rng(1)
    interval = ConformalInterval.calibrate(recordings(rng, 3), recordings(rng, 5), coverage=0.9, limit=1e-3)
    assert interval.bounds(np.full(20, 5e-4)) == (0.0, 1e-3)
    assert interval.bounds(np.full(20, 1.5e-3)) == (0.0, 1.5e-3)  # and never leave the estimate outside


def test_an_interval_survives_json():
    rng = np.random.default_rng(2)
    interval = ConformalInterval.calibrate(recordings(rng, 10), recordings(rng, 40))
    assert ConformalInterval.from_json(interval.to_json()) == interval


def test_low_end_is_never_negative():
    rng = np.random.default_rng(3)
    interval = ConformalInterval.calibrate(recordings(rng, 10), recordings(rng, 40))
    assert interval.bounds(np.full(20, -1e-5))[0] == 0.0


def test_coverage_must_be_a_share():
    with pytest.raises(InputError, match=r"calibration\.coverage=1"):
        ConformalInterval.calibrate(recordings(np.random.default_rng(0), 3), [], coverage=1.0)


@given(n=st.integers(1, 60), coverage=st.floats(0.05, 0.95))
def test_the_quantile_is_the_smallest_score_that_covers_in_finite_samples(n, coverage):
    scores = np.arange(1.0, n + 1)
    value = conformal_quantile(scores, coverage)
    if value is None:
        assert n / (n + 1) < coverage
    else:
        assert value / (n + 1) >= coverage - 1e-9
        assert (value - 1) / (n + 1) < coverage


@pytest.mark.parametrize("each", [1, 12])
def test_the_stated_share_holds_on_machines_that_nobody_has_seen(each):
    """What recordings of one machine share is an error that more of them do not average out."""
    rng = np.random.default_rng(4)

    def machines(count, of_each):
        return [
            (error + 0.05 * rng.normal(), machine)
            for machine, error in enumerate(rng.normal(size=count))
            for _ in range(of_each)
        ]

    held = []
    for _ in range(400):
        scores, whose = map(np.array, zip(*machines(12, each), strict=True))
        limit = conformal_quantile(np.abs(scores), 0.8, whose)
        held += [abs(error) <= limit for error, _ in machines(5, 1)]
    # Theory: 0.8 to 0.8 + 1/13; 400 calibrations of 12 machines scatter it by 0.006, 2000 trials by 0.009.
    assert 0.8 - 0.03 < np.mean(held) < 0.8 + 1.0 / 13.0 + 0.03


def test_machines_of_many_recordings_weigh_no_more_than_others():
    scores, machines = np.array([1.0] * 50 + [2.0, 3.0, 4.0]), np.array([0] * 50 + [1, 2, 3])
    assert [conformal_quantile(scores, share, machines) for share in (0.2, 0.4, 0.6, 0.8, 0.81)] == [
        1.0, 2.0, 3.0, 4.0, None,
    ]  # fmt: skip


def test_odd_windows_do_not_move_the_estimate():
    values = np.array([1.0] * 9 + [100.0])
    assert robust_mean(values) == 1.0
    assert spread(values) == 0.0
