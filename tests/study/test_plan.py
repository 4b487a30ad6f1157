"""The order of value, and what is begun in the time that is left."""

import pytest

from clearance.errors import InputError
from clearance.evaluation.paper.trainings import Setting, Training, trainings_of
from clearance.study.__main__ import seconds_of
from clearance.study.plan import Batch, Cost, expected_seconds, stages, that_fit

LSTM = Setting("lstm")
TABLES = ("table5", "table6", "table8", "table9", "tdnn_variants", "decimation")


@pytest.fixture(scope="module")
def order():
    return stages([trainings_of(name) for name in TABLES])


def test_every_row_once_comes_before_a_second_split_and_all_splits_before_a_second_initialisation(order):
    first, splits, seeds = ([t for batch in stage for t in batch.trainings] for stage in order)
    assert {(t.split_seed, t.seed) for t in first} == {(98, 42)}
    assert {(t.split_seed, t.seed) for t in splits} == {(42, 42), (1024, 42)}
    assert all(t.seed != 42 for t in seeds)
    settings = {t.setting for name in TABLES for t in trainings_of(name)}
    assert {t.setting for t in first} == settings
    assert [t.setting.model for t in first[:5]] == ["random_forest", "xgboost", "tdnn", "lstm", "gru"]


def test_nothing_is_trained_twice_and_nothing_is_forgotten(order):
    every = [t for stage in order for batch in stage for t in batch.trainings]
    assert len(every) == len(set(every))
    assert set(every) == {t for name in TABLES for t in trainings_of(name)}


def test_the_seeds_of_a_row_and_split_are_one_batch(order):
    assert Batch(LSTM, 98, (98, 123, 456, 789, 1024, 2048, 4096, 8192, 9999)) in order[2]


def test_a_cost_is_the_median_of_the_like_or_scaled_by_the_samples():
    costs = [Cost("lstm", 10, 30.0), Cost("lstm", 10, 50.0), Cost("lstm", 10, 31.0), Cost("gru", 10, 9.0)]
    assert expected_seconds(LSTM, costs) == 31.0
    assert expected_seconds(LSTM._replace(decimation=1), costs) == 310.0
    assert expected_seconds(Setting("tdnn"), costs) is None


def test_only_what_ends_in_time_is_begun():
    batch = Batch(LSTM, 98, (1, 2, 3))
    assert that_fit(batch, 40.0, 100.0, {}).seeds == (1, 2)
    assert that_fit(batch, 40.0, 39.0, {}).seeds == ()
    assert that_fit(batch, None, 39.0, {}).seeds == (1,)  # nobody knows: it is measured by that
    assert that_fit(batch, 40.0, 39.0, {Training(LSTM, 98, 1): True}).seeds == (
        1,
    )  # goes on where it was cut


@pytest.mark.parametrize(
    ("text", "seconds"), [("90s", 90), ("30m", 1800), ("2h", 7200), ("1.5 h", 5400), ("1d", 86400)]
)
def test_a_budget_is_read(text, seconds):
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["2", "h", "-1h", "0m", None, "2 weeks"])
def test_what_is_no_budget_is_refused(text):
    with pytest.raises(InputError, match="no duration such as 90s, 30m, 2h or 1d; change budget"):
        seconds_of(text)
