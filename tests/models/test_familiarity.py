import re

import numpy as np
import pytest

from clearance.models.familiarity import Familiarity

CHANNELS = ("rod_b_axial", "rod_c_axial")
RATE, LENGTH = 1e4, 200


def recordings(rng, count, samples=2000, level=1.0, tone=0.0):
    """Coloured noise and a turning speed, scaled."""
    made = []
    for _ in range(count):
        time = np.arange(samples) / RATE
        speed = rng.uniform(50, 100)
        phase = rng.uniform(0, 6)
        signal = np.sin(speed * time + phase)[:, None] + rng.normal(0, 0.3, (samples, 2))
        signal[:, 1] += tone * np.sin(2 * np.pi * 3000 * time)
        made.append((level * signal).astype(np.float32))
    return made


@pytest.fixture(scope="module")
def familiarity():
    rng = np.random.default_rng(0)
    return Familiarity.calibrate(
        CHANNELS, (True, True), RATE, LENGTH, recordings(rng, 150), recordings(rng, 100), false_rejection=0.05
    )


@pytest.mark.parametrize("samples", [200, 1000, 2000, 5000])
def test_familiar_recordings_are_rarely_refused(familiarity, samples):
    rng = np.random.default_rng(1)
    refused = np.mean([not familiarity.judge(r)[0] for r in recordings(rng, 300, samples)])
    # 0.05 wanted; 100 calibration recordings scatter it by 0.022 and 300 trials by 0.013: three of both.
    assert refused < 0.05 + 3 * np.hypot(0.022, 0.013)


@pytest.mark.parametrize("samples", [200, 2000])
def test_of_the_recordings_that_set_the_limit_just_the_stated_share_is_beyond_it(samples):
    rng = np.random.default_rng(6)
    training, own = recordings(rng, 150), recordings(rng, 100)
    known = Familiarity.calibrate(CHANNELS, (True, True), RATE, LENGTH, training, own, false_rejection=0.05)
    assert sum(not known.judge(r[:samples])[0] for r in own) == 4  # the limit is the 96th of 100 distances


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"level": 2.0}, "stronger"),
        ({"tone": 0.5}, "rod_c_axial carries"),
        ({"level": 0.0}, "weaker|less"),
    ],
)
def test_foreign_recordings_are_refused_in_words(familiarity, change, words):
    for recording in recordings(np.random.default_rng(2), 5, **change):
        trusted, reason = familiarity.judge(recording)
        assert not trusted
        assert re.search(words, reason), reason


def test_a_channel_that_was_constant_must_stay_so():
    rng = np.random.default_rng(3)

    def still(count):
        return [np.column_stack([r[:, 0], 0 * r[:, 1]]) for r in recordings(rng, count)]

    familiarity = Familiarity.calibrate(CHANNELS, (True, False), RATE, LENGTH, still(60), still(60))
    assert familiarity.judge(still(1)[0])[0]
    trusted, reason = familiarity.judge(recordings(rng, 1)[0])
    assert not trusted
    assert "rod_c_axial was constant in training" in reason
    trusted, reason = familiarity.judge(still(1)[0] + [0.0, 9.81])  # gravity, where there was none
    assert not trusted
    assert "rod_c_axial was constant in training and lies +9.81 from there" in reason


def test_the_rate_that_is_stated_is_one_that_can_be_kept():
    rng = np.random.default_rng(4)
    few = Familiarity.calibrate(
        CHANNELS, (True, True), RATE, LENGTH, recordings(rng, 9), recordings(rng, 9), 0.01
    )
    assert few.false_rejection == 0.1


def test_json_keeps_the_judgement(familiarity):
    again = Familiarity.from_json(familiarity.to_json())
    for recording in recordings(np.random.default_rng(5), 5):
        assert again.judge(recording) == familiarity.judge(recording)
