"""Statistics of a comparison against SciPy's, a worked example, and their rate of false alarms."""

import numpy as np
import pytest
from scipy import stats

from clearance.evaluation.paper.statistics import compare, corrected_error, holm, summarise


def test_mean_deviation_and_interval_are_scipys():
    values = np.random.default_rng(1).normal(0.5, 0.2, 30)
    found = summarise(values.tolist())
    low, high = stats.t.interval(0.95, 29, values.mean(), stats.sem(values))
    assert (found.count, found.mean) == (30, pytest.approx(values.mean()))
    assert found.deviation == pytest.approx(values.std(ddof=1))
    assert (found.low, found.high) == (pytest.approx(low), pytest.approx(high))


def test_the_papers_interval_follows_from_its_mean_and_deviation():
    # Section 5.1.2: LSTM, 30 runs, NMAE 0.49 ± 0.14 %, interval [0.44, 0.54]
    values = np.random.default_rng(2).normal(size=30)
    values = 0.49 + 0.14 * (values - values.mean()) / values.std(ddof=1)
    found = summarise(values.tolist())
    assert (round(found.low, 2), round(found.high, 2)) == (0.44, 0.54)


def test_one_value_has_no_spread():
    found = summarise([0.7])
    assert (found.mean, found.deviation, found.low, found.high) == (0.7, None, None, None)


def test_the_corrected_error_of_a_worked_example():
    # Differences 1, 2, 3: s² = 1; a test set a fifth of the training set: (1/3 + 1/5) s² = 8/15.
    assert corrected_error([1.0, 2.0, 3.0], 0.2) == pytest.approx((8 / 15) ** 0.5)
    assert corrected_error([1.0], 0.2) is None


def models(rng, splits=3, seeds=10, gap=0.0):
    one = {(split, seed): rng.normal() for split in range(splits) for seed in range(seeds)}
    return one, {key: value + gap + 0.3 * rng.normal() for key, value in one.items()}


def test_a_comparison_is_scipys_paired_test_and_the_corrected_test_over_splits():
    one, other = models(np.random.default_rng(3), gap=0.5)
    found = compare(one, other, 0.15 / 0.70)
    keys = sorted(one)
    paired = stats.ttest_rel([one[key] for key in keys], [other[key] for key in keys])
    assert found.paired_p == pytest.approx(paired.pvalue)
    assert (found.pairs, found.splits) == (30, 3)
    by_split = [np.mean([one[s, i] - other[s, i] for i in range(10)]) for s in range(3)]
    # Without its correction the test over splits would be the plain one: p from t enlarged by a known factor.
    plain = stats.ttest_1samp(by_split, 0.0)
    t = plain.statistic * np.sqrt((1 / 3) / (1 / 3 + 0.15 / 0.70))
    assert found.corrected_p == pytest.approx(2 * stats.t.sf(abs(t), 2))
    reach = stats.t.ppf(0.975, 2) * np.mean(by_split) / t
    assert (found.low, found.high) == (
        pytest.approx(np.mean(by_split) - abs(reach)), pytest.approx(np.mean(by_split) + abs(reach)),
    )  # fmt: skip


def test_only_shared_splits_and_seeds_are_compared():
    found = compare({(1, 1): 0.5, (1, 2): 0.6}, {(1, 1): 0.4, (2, 1): 9.0}, 0.2)
    assert (found.pairs, found.difference) == (1, pytest.approx(0.1))
    assert (found.paired_p, found.corrected_p, found.low) == (None, None, None)
    assert compare({(1, 1): 0.5}, {(2, 1): 0.4}, 0.2) is None


def test_where_splits_differ_the_corrected_test_is_seldom_wrong_and_the_paired_one_often():
    # No difference on average, but each split favours one model by chance, as test recordings do.
    rng, wrong = np.random.default_rng(4), np.zeros(2)
    for _ in range(400):
        one, other = {}, {}
        for split in range(3):
            favour = rng.normal(0.0, 0.5)
            for seed in range(10):
                one[split, seed], other[split, seed] = rng.normal(0, 0.3), favour + rng.normal(0, 0.3)
        found = compare(one, other, 0.15 / 0.70)
        wrong += [found.paired_p < 0.05, found.corrected_p < 0.05]
    assert wrong[0] > 0.3 * 400
    assert stats.binomtest(int(wrong[1]), 400, 0.05, "greater").pvalue > 0.01


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []
