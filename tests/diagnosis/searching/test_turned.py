"""An angle of a sensor beside whose axis nothing moves is a gain: both are told."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.turned import fit_twins
from clearance.diagnosis.sensing.instrument import Instrument
from tests.diagnosis.attempts import attempt

ANGLE = 21.91  # deg


def fault(name, channel, low, high):
    unknown = SimpleNamespace(name="size", low=low, high=high)
    return SimpleNamespace(name=name, channel=channel, unknowns=(unknown,))


def fitted(*found):
    """What is asked for beside faults (name, channel, size) that explain."""
    best, asked = attempt([name for name, _, _ in found], 1.0), []
    best.hypotheses = tuple(fault(name, channel, -90.0, 90.0) for name, channel, _ in found)
    best.fit.values = np.array([[3e-4, *(size for *_, size in found), 700.0]] * 2)
    best.followers = ["its paths"]
    groups = {
        (name, channel): [fault(name, channel, *bounds)]
        for channel in ("slider_horizontal", "rod_b_axial")
        for name, bounds in (("sensor_gain", (0.1, 10.0)), ("sensor_misalignment", (-45.0, 45.0)))
    }

    def refit(explanation, held, followers, values, scale):
        assert (followers, scale) == (best.followers, best.scale)
        asked.append(([(one.name, one.channel) for one in held], values.tolist()))

    fit_twins(SimpleNamespace(groups=groups, refit=refit), Explanation(attempt([], 40.0), [best]))
    return asked


def test_a_gain_and_an_angle_of_the_sliders_sensor_are_the_same():
    horizontal = np.random.default_rng(0).normal(size=(100, 1))
    turned = Instrument(misalignment={"slider_horizontal": ANGLE})
    weaker = Instrument(gain={"slider_horizontal": np.cos(np.radians(ANGLE))})
    seen = [
        one.apply(
            np.column_stack([horizontal, 0.0 * horizontal]), ["slider_horizontal", "slider_vertical"], 1e4
        )
        for one in (turned, weaker)
    ]
    np.testing.assert_allclose(seen[0][:, 0], seen[1][:, 0], rtol=1e-12)


def test_in_the_place_of_either_the_other_one_is_fitted():
    gain = float(np.cos(np.radians(ANGLE)))
    ((held, values),) = fitted(("gravity", None, 9.81), ("sensor_gain", "slider_horizontal", gain))
    assert held == [("gravity", None), ("sensor_misalignment", "slider_horizontal")]
    assert values == [pytest.approx([3e-4, 9.81, ANGLE, 700.0])] * 2
    ((held, values),) = fitted(("sensor_misalignment", "slider_horizontal", -ANGLE))
    assert held == [("sensor_gain", "slider_horizontal")]
    assert values == [pytest.approx([3e-4, gain, 700.0])] * 2


@pytest.mark.parametrize(
    "found",
    [
        ("sensor_gain", "slider_horizontal", 1.05),  # no cosine
        ("sensor_gain", "slider_horizontal", 0.5),  # no sensor is turned by 60 degrees
        ("sensor_gain", "rod_b_axial", 0.93),  # its other axis moves
        ("sensor_bias", "slider_horizontal", 0.93),
    ],
)
def test_nothing_else_has_a_twin(found):
    assert fitted(found) == []
