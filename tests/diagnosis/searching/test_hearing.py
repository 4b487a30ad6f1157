"""Of two faults of one sensor, the one that tells what was recorded."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.scrutiny import hear
from clearance.diagnosis.sensing.instrument import Instrument
from tests.diagnosis.attempts import attempt

CHANNEL, OTHER = "rod_c_axial", "rod_c_transverse"
RATE = 1e4
LATE = Instrument(delay={CHANNEL: 1.8e-4})
SLUGGISH = Instrument(resonance={CHANNEL: 1640.0}, resonance_damping={CHANNEL: 0.81})


def heard(name, misfit, recorded, predicted, instrument, channel=CHANNEL):
    found = attempt([name], misfit)
    found.hypotheses[0].channel = channel
    measured = SimpleNamespace(
        channels=(CHANNEL, OTHER), values=recorded.reshape(-1, 10, 2), sigma=np.full(2, 0.05),
        chain=SimpleNamespace(rate=RATE),
        seen=lambda one, faults: faults.apply(one.reshape(-1, 2), (CHANNEL, OTHER), RATE).reshape(one.shape),
    )  # fmt: skip
    found.followers = [SimpleNamespace(measured=measured)]
    found.fit.passes = [SimpleNamespace(predicted=predicted.reshape(-1, 10, 2), samples=len(predicted))]
    found.fit.values, found.model.instrument = np.zeros((1, 3)), lambda _: instrument
    return found


@pytest.mark.parametrize(("true", "expected"), [(LATE, "sensor_delay"), (SLUGGISH, "sensor_resonance")])
def test_a_delay_and_a_resonance_are_told_apart_by_the_recording_as_it_is(true, expected):
    rng = np.random.default_rng(3)
    predicted = rng.normal(size=(2000, 2))
    recorded = true.apply(predicted, (CHANNEL, OTHER), RATE) + 0.05 * rng.normal(size=(2000, 2))
    delay = heard("sensor_delay", 0.95, recorded, predicted, LATE)
    resonance = heard("sensor_resonance", 0.94, recorded, predicted, SLUGGISH)
    elsewhere = heard("sensor_gain", 1.02, recorded, predicted, Instrument(), OTHER)
    explanation = Explanation(attempt([], 40.0), [resonance, delay, elsewhere])
    hear(explanation)
    assert explanation.best.hypotheses[0].name == expected
    assert not elsewhere.withdrawn


def test_faults_that_tell_it_as_well_both_stand():
    predicted = np.random.default_rng(3).normal(size=(2000, 2))
    both = [heard(name, 1.0, predicted, predicted, Instrument()) for name in ("sensor_gain", "sensor_bias")]
    explanation = Explanation(attempt([], 40.0), both)
    hear(explanation)
    assert not any(one.withdrawn for one in both)


def test_the_same_fault_beside_other_lobes_is_no_rival():
    predicted = np.random.default_rng(3).normal(size=(2000, 2))
    worse = heard("sensor_gain", 0.95, predicted, predicted, LATE)
    better = heard("sensor_gain", 1.02, predicted, predicted, Instrument())
    explanation = Explanation(attempt([], 40.0), [worse, better])
    hear(explanation)
    assert explanation.best is worse
