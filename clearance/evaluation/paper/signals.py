"""Figures 2, 5 and 6: what a clearance does to the slider's acceleration, and what decimation leaves of it.

Clearance in C, steady motion from 2 s on, as in the data sets (paper, Sections 2 and 4.2).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from scipy import signal

from clearance.errors import InputError
from clearance.evaluation.figures import new_figure
from clearance.mechanism.parameters import require, require_list
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.simulation.batch import Sampling, run_batch
from clearance.simulation.decimation import Decimation
from clearance.simulation.failure import Failure
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal

_START, _SECONDS = 2.0, 1.0  # s
_REVOLUTIONS = 2.0  # shown at most, of these seconds
_LOWEST = 50.0  # Hz: below it is the machine's own motion
_LINEAR = 500.0  # m/s²
_TICKS = (-500.0, 0.0, 500.0, 2000.0, 10_000.0)
_SHARE = 0.99  # of the power
_COLOURS = ("#1f4e79", "#c55a11", "#548235", "#7030a0", "#7f6000")
_DECIMATED = "#c00000"


@dataclass(frozen=True)
class SliderSignals:
    """The machine, and which of its signals are shown.

    Attributes:
        mechanism: the machine.
        integrator: scheme and steps.
        chain: of measurement.
        clearances: shown one by one [m].
        speed_rpm: of the crank [rpm]; 120 or more, two revolutions a second.
    """

    mechanism: SliderCrank
    integrator: Integrator
    chain: MeasurementChain
    clearances: Sequence[float]
    speed_rpm: float

    def __post_init__(self) -> None:
        require_list(self, len(self.clearances), 0.0, 2e-3, clearances=self.clearances)
        require(self, 60.0 * _REVOLUTIONS / _SECONDS, 2e4, speed_rpm=self.speed_rpm)
        if not 1 <= len(self.clearances) <= len(_COLOURS):
            raise InputError(
                f"clearances = {list(self.clearances)}: 1 to {len(_COLOURS)} can be told apart; "
                "change clearances"
            )

    def simulated(self, clearances: Sequence[float]) -> np.ndarray:
        """(clearances, samples) horizontal acceleration of the slider at the base rate [m/s²]."""
        sampling = Sampling(self.chain.base_rate, Decimation.none(), _START, _SECONDS)
        found = np.empty((len(clearances), sampling.samples))
        nominal = replace(self.mechanism, drive=self.mechanism.drive.at_speed(self.speed_rpm))

        def keep(index: int, outcome: np.ndarray | Failure) -> None:
            if isinstance(outcome, Failure):
                raise InputError(f"clearance {clearances[index]:g} m: {outcome}; change clearances")
            found[index] = outcome[:, Signal.SLIDER_HORIZONTAL]

        machines = [replace(nominal, joint_c=replace(nominal.joint_c, clearance=c)) for c in clearances]
        run_batch(machines, self.integrator, sampling, keep)
        return found

    def revolution(self, rate: float, revolutions: float = 1.0) -> int:
        """Samples of so many revolutions."""
        return round(revolutions * 60.0 / self.speed_rpm * rate)


@dataclass(frozen=True)
class AccelerationByClearance(SliderSignals):
    """Figure 2."""

    def draw(self, found: object = None) -> Figure:
        """A panel a clearance, two revolutions; the axes are shared so that sizes compare.

        Linear to 500 m/s² and logarithmic beyond: impacts are a hundred times what the motion itself takes.
        """
        signals, rate = self.simulated(self.clearances), self.chain.base_rate
        shown = self.revolution(rate, _REVOLUTIONS)
        figure = new_figure(8, 1.9 * len(signals) + 0.6)
        panels = np.atleast_1d(figure.subplots(len(signals), 1, sharex=True, sharey=True))
        for axes, values, clearance, colour in zip(panels, signals, self.clearances, _COLOURS, strict=False):
            axes.plot(np.arange(shown) / rate * 1e3, values[:shown], color=colour, linewidth=0.7)
            axes.set_yscale("symlog", linthresh=_LINEAR, linscale=1.5)
            axes.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
            axes.minorticks_off()
            axes.set(title=f"clearance {clearance * 1e3:g} mm")
            axes.margins(x=0)
        figure.supylabel("slider acceleration [m/s²]")
        panels[-1].set(xlabel=f"time [ms], two revolutions at {self.speed_rpm:g} rpm")
        return figure


@dataclass(frozen=True)
class BeforeAndAfterDecimation(SliderSignals):
    """Figure 5."""

    def draw(self, found: object = None) -> Figure:
        """A row a clearance: one revolution, and the amplitude spectrum of a second."""
        signals, rate = self.simulated(self.clearances), self.chain.base_rate
        figure = new_figure(11, 2.4 * len(signals) + 0.8)
        panels = figure.subplots(len(signals), 2, sharex="col", squeeze=False)
        for (left, right), values, clearance in zip(panels, signals, self.clearances, strict=True):
            versions = {
                f"{rate / 1e3:g} kHz, simulated": (values, rate, _COLOURS[0], 0.6),
                f"{self.chain.rate / 1e3:g} kHz, decimated": (
                    self.chain.apply(values[:, None])[:, 0], self.chain.rate, _DECIMATED, 0.9,
                ),
            }  # fmt: skip
            for label, (series, own_rate, colour, width) in versions.items():
                shown = self.revolution(own_rate)
                time = np.arange(shown) / own_rate * 1e3
                left.plot(time, series[:shown], color=colour, linewidth=width, label=label)
                frequency, amplitude = amplitude_spectrum(series, own_rate)
                right.loglog(frequency[1:], amplitude[1:], color=colour, linewidth=width, label=label)
            left.set(title=f"clearance {clearance * 1e3:g} mm", ylabel="acceleration [m/s²]")
            left.margins(x=0)
            right.set(
                title="its amplitude spectrum",
                ylabel="amplitude [m/s²]",
                xlim=(self.speed_rpm / 60, rate / 2),
                ylim=(1e-4, 1e3),
            )
        panels[0, 0].legend(loc="lower right", fontsize=8)
        panels[-1, 0].set(xlabel=f"time [ms], one revolution at {self.speed_rpm:g} rpm")
        panels[-1, 1].set(xlabel="frequency [Hz]")
        return figure


@dataclass(frozen=True)
class OccupiedBandwidth(SliderSignals):
    """Figure 6.

    Attributes:
        sweep: first and last clearance [m] of the curve, and how many.
    """

    sweep: Sequence[float] = (2e-5, 1e-3, 50)

    def draw(self, found: object = None) -> Figure:
        """Power densities with their bands, and the upper end of the band over the clearance."""
        rate = self.chain.base_rate
        figure = new_figure(12, 4.6)
        halves = figure.add_gridspec(1, 2)
        left, right = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
        panels = np.atleast_1d(left.subplots(len(self.clearances), 1, sharex=True))
        for axes, values, clearance in zip(
            panels, self.simulated(self.clearances), self.clearances, strict=True
        ):
            frequency, density = power_density(values, rate)
            low, high = occupied_band(values, rate)
            axes.loglog(frequency, density, color=_COLOURS[0], linewidth=0.5)
            axes.axvspan(low, high, color="#9dc3e6", alpha=0.5, linewidth=0)
            axes.set(
                title=f"clearance {clearance * 1e3:g} mm: 99.5 % of the power below {high / 1e3:.2g} kHz"
            )
            axes.set(xlim=(_LOWEST, rate / 2), ylim=(density.max() * 1e-9, density.max() * 3))
        left.supylabel("power density [(m/s²)²/Hz]")
        panels[-1].set(xlabel="frequency [Hz]")

        clearances = np.linspace(self.sweep[0], self.sweep[1], int(self.sweep[2]))
        signals = self.simulated(clearances.tolist())
        axes = right.subplots()
        upper = np.array([occupied_band(values, rate)[1] for values in signals]) / 1e3
        axes.semilogy(
            clearances * 1e3, upper, "o-", color=_COLOURS[0], markersize=3, label=f"{rate / 1e3:g} kHz"
        )
        kept = self.chain.apply(signals.T).T
        upper = np.array([occupied_band(values, self.chain.rate)[1] for values in kept]) / 1e3
        label = f"decimated to {self.chain.rate / 1e3:g} kHz"
        axes.semilogy(clearances * 1e3, upper, "s-", color=_DECIMATED, markersize=3, label=label)
        axes.axhline(self.chain.rate / 2e3, color="0.5", linewidth=0.8, linestyle="--")
        axes.annotate(
            f"half of {self.chain.rate / 1e3:g} kHz", (clearances[-1] * 1e3, self.chain.rate / 2e3),
            fontsize=8, va="bottom", ha="right",
        )  # fmt: skip
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set(xlabel="clearance [mm]", ylabel="upper end of the band with 99 % of the power [kHz]")
        axes.legend(loc="lower right")
        return figure


def amplitude_spectrum(values: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and amplitudes of a Hann-windowed signal: a sine's peak is its amplitude."""
    window = signal.windows.hann(len(values), sym=False)
    spectrum = np.abs(np.fft.rfft(window * (values - values.mean()))) * 2.0 / window.sum()
    return np.fft.rfftfreq(len(values), 1.0 / rate), spectrum


def power_density(values: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Periodogram from 50 Hz on: frequencies [Hz] and densities [unit²/Hz]."""
    frequency, density = signal.periodogram(values, rate)
    kept = frequency >= _LOWEST
    return frequency[kept], density[kept]


def occupied_band(values: np.ndarray, rate: float) -> tuple[float, float]:
    """Frequencies [Hz] between which 99 % of the power above 50 Hz lie, 0.5 % on either side of them."""
    frequency, density = power_density(values, rate)
    power = np.cumsum(density) / density.sum()
    low, high = np.searchsorted(power, [(1 - _SHARE) / 2, (1 + _SHARE) / 2])
    return float(frequency[low]), float(frequency[min(high, len(frequency) - 1)])
