"""Spectra and bands of signals that are known, and the figures made of them."""

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.evaluation.paper.signals import (
    AccelerationByClearance,
    BeforeAndAfterDecimation,
    OccupiedBandwidth,
    amplitude_spectrum,
    occupied_band,
)
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.simulation.integrator import Integrator

RATE = 1e4
TIME = np.arange(int(RATE)) / RATE


def test_a_sines_peak_is_its_amplitude_at_its_frequency():
    frequency, amplitude = amplitude_spectrum(5.0 + 3.0 * np.sin(2 * np.pi * 440.0 * TIME), RATE)
    assert frequency[amplitude.argmax()] == 440.0
    assert amplitude.max() == pytest.approx(3.0)


def test_white_noise_occupies_99_percent_of_what_is_above_50_hertz():
    low, high = occupied_band(np.random.default_rng(0).normal(size=200_000), RATE)
    # 0.5 % of 50 to 5000 Hz on either side; 20 s of noise put each end within some hertz
    assert low == pytest.approx(50 + 0.005 * 4950, abs=6)
    assert high == pytest.approx(5000 - 0.005 * 4950, abs=6)


def test_what_is_below_50_hertz_does_not_count():
    tone = np.sin(2 * np.pi * 700.0 * TIME)
    assert occupied_band(tone + 100.0 * np.sin(2 * np.pi * 10.0 * TIME), RATE) == (700.0, 700.0)


def signals(kind, **more):
    return kind(SliderCrank(), Integrator("semi_implicit_euler", 1e-5), MeasurementChain(), **more)


def test_an_impossible_number_of_clearances_is_refused():
    with pytest.raises(InputError, match="1 to 5 can be told apart"):
        signals(AccelerationByClearance, clearances=[1e-4] * 6, speed_rpm=500.0)


@pytest.mark.parametrize("kind", [AccelerationByClearance, BeforeAndAfterDecimation])
def test_two_revolutions_a_second_are_the_least_that_can_be_shown(kind):
    with pytest.raises(InputError, match=r"speed_rpm = 119 is outside \[120, 20000\]; change"):
        signals(kind, clearances=[1e-4], speed_rpm=119.0)
    slowest = signals(kind, clearances=[1e-4], speed_rpm=120.0)
    assert slowest.draw().axes[0].get_lines()


def test_the_figures_show_what_was_simulated():
    chosen = signals(OccupiedBandwidth, clearances=[1e-4, 8e-4], speed_rpm=500.0, sweep=(1e-4, 8e-4, 2))
    figure = chosen.draw()
    titles = [axes.get_title() for axes in figure.axes]
    full, decimated = (line.get_ydata() for line in figure.axes[-1].get_lines()[:2])
    assert f"99.5 % of the power below {full[1]:.2g} kHz" in titles[1]
    assert full[1] > 10 > 5 > decimated[1]  # the impacts of a large clearance do not survive decimation
    assert full[0] == pytest.approx(decimated[0], rel=0.05)
    panels = signals(AccelerationByClearance, clearances=[1e-4, 8e-4], speed_rpm=500.0).draw().axes
    small, large = (np.abs(axes.get_lines()[0].get_ydata()).max() for axes in panels)
    assert large > 10 * small
