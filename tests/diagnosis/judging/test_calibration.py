"""Simulations of the fitted machine, by which to tell how unusual recordings are."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.judging import calibration
from clearance.diagnosis.judging.calibration import _runs, simulated_scores
from clearance.diagnosis.sensing.demonstration import record
from clearance.diagnosis.sensing.measured import Measured, chain_of
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank

MACHINE = SliderCrank(joint_c=Joint(clearance=3e-4), drive=SpeedControl(700.0))


@pytest.fixture(scope="module")
def measured():
    recording = record(MACHINE, 1)
    rod = recording.select(("rod_b_axial", "rod_c_axial"))
    return Measured.of(rod, chain_of(rod, "a"), "a")


def test_simulated_recordings_are_as_long_and_as_noisy_and_none_is_another(measured):
    nominal = SimpleNamespace(
        model=SimpleNamespace(machine=lambda values: MACHINE),
        fit=SimpleNamespace(values=np.array([[3e-4, 700.0]])),
    )
    one, other = _runs(nominal, 0, measured, range(2), 1)
    assert one.values.shape == other.values.shape == measured.values.shape
    assert one.channels == measured.channels
    size, recorded = one.values.std(axis=(0, 1)), measured.values.std(axis=(0, 1))
    np.testing.assert_allclose(size, recorded, rtol=0.15)  # other impacts
    np.testing.assert_allclose(one.sigma / size, measured.sigma / recorded, rtol=0.1)
    (alone,) = _runs(nominal, 0, measured, range(1, 2), 1)
    np.testing.assert_allclose(alone.values, other.values)
    assert np.all((one.values - other.values).std(axis=(0, 1)) > 3.0 * measured.sigma)


def test_what_was_simulated_when_it_is_interrupted_counts(monkeypatch):
    scores = iter([7.0, np.inf, 3.0])

    def score(*_):
        try:
            return next(scores)
        except StopIteration:
            raise KeyboardInterrupt from None

    monkeypatch.setattr(calibration, "_runs", lambda *of: [None] * len(of[3]))
    monkeypatch.setattr(calibration, "_score", score)
    said = []
    search = SimpleNamespace(recordings=[None], workers=1, report=said.append)
    np.testing.assert_array_equal(simulated_scores(search, None, (1.0, 2.0), 19), [3.0, 7.0, np.inf])
    assert said[-1] == "interrupted: 3 of 19 simulations count"
