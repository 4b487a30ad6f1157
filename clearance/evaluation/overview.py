"""The README's picture: the machine, what its sensors feel, what a trained model makes of it."""

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from clearance.evaluation.figures import new_figure
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.simulation.batch import Sampling, simulate
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal

_CLEARANCES = (1e-4, 4e-4, 8e-4)  # m, shown side by side
_SPEED = 500.0  # rpm
_APART = 1500.0  # m/s^2 between two signals
_SHOWN = 2.5  # of the error that 95 % stay below: what is further off is drawn at the edge


def overview(fresh: list[dict[str, Any]], name: str) -> Figure:
    """Three panels.

    Args:
        fresh: what ``FreshEvaluation.to_json`` gave of each joint.
        name: of the model that made it.
    """
    figure = new_figure(13, 4.2)
    machine, signals, estimates = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
    _draw_machine(machine)
    _draw_signals(signals)
    _draw_estimates(estimates, fresh, name)
    return figure


def _draw_machine(axes: Axes) -> None:
    machine, angle, gap = SliderCrank(), np.radians(55.0), 0.011
    bx, by = float(machine.crank.length * np.cos(angle)), float(machine.crank.length * np.sin(angle))
    cx = bx + float(np.sqrt(machine.rod.length**2 - by**2))
    jx, jy = cx - 0.34 * gap, 0.25 * gap
    for height in (-0.0165, 0.0165):
        axes.plot([-0.02, 0.21], [height, height], color="0.6", linewidth=1, zorder=0)
    axes.add_patch(Rectangle((cx - 0.024, -0.0165), 0.048, 0.033, facecolor="0.88", edgecolor="0.3"))
    axes.plot([0.0, bx], [0.0, by], color="#1f4e79", linewidth=7, solid_capstyle="round")
    axes.plot([bx, jx], [by, jy], color="#c55a11", linewidth=5, solid_capstyle="round")
    axes.add_patch(Circle((cx, 0.0), gap, facecolor="white", edgecolor="0.3", zorder=3))
    axes.add_patch(Circle((jx, jy), gap * 0.58, facecolor="#c55a11", edgecolor="0.2", zorder=4))
    for point in ((0.0, 0.0), (bx, by)):
        axes.add_patch(Circle(point, 0.0045, facecolor="white", edgecolor="0.2", zorder=4))
    for place, text in (((-0.014, -0.008), "A"), ((bx - 0.003, by + 0.009), "B"), ((cx + 0.014, 0.021), "C")):
        axes.annotate(text, place, fontsize=12)
    arrow = {"arrowstyle": "->"}
    axes.annotate("clearance\n(exaggerated)", (cx + 0.8 * gap, 0.0), (cx - 0.02, -0.062), arrowprops=arrow)
    middle = ((bx + jx) / 2, (by + jy) / 2)
    axes.annotate("accelerometers\non the rod", middle, (0.085, 0.062), arrowprops=arrow)
    axes.set(xlim=(-0.025, 0.215), ylim=(-0.075, 0.09), aspect="equal", title="the machine")
    axes.axis("off")


def _draw_signals(axes: Axes) -> None:
    chain = MeasurementChain()
    sampling = Sampling(chain.base_rate, chain.filter(), 1.0, 60.0 / _SPEED)
    time = np.arange(sampling.samples) / sampling.rate * 1e3
    for row, clearance in enumerate(_CLEARANCES):
        nominal = SliderCrank(drive=SpeedControl(_SPEED))
        machine = replace(nominal, joint_c=replace(nominal.joint_c, clearance=clearance))
        signal = simulate(machine, Integrator("runge_kutta_4", 1e-5, 4), sampling)[:, Signal.ROD_C_TRANSVERSE]
        axes.plot(time, signal - _APART * row, linewidth=0.7, label=f"{clearance * 1e3:g} mm")
    axes.plot([118.0, 118.0], [600.0, 1600.0], color="0.2", linewidth=2, solid_capstyle="butt")
    axes.annotate("1000 m/s²", (116.0, 1000.0), fontsize=9, ha="right")
    # an impact of the loosest joint may be ten times as high as there is room
    axes.set(ylim=(-2.0 * _APART - 1800.0, 2000.0), yticks=[])
    axes.set(xlabel="time [ms], one revolution", title="rod at C, transverse, by clearance")
    axes.legend(loc="lower right", fontsize=8, ncols=3)


def _draw_estimates(axes: Axes, fresh: list[dict[str, Any]], name: str) -> None:
    truth, estimate, low, high = (
        np.concatenate([joint[key] for joint in fresh]) * 1e3 for key in ("truth", "estimate", "low", "high")
    )
    error = (estimate - truth) * 1e3
    edge = max(_SHOWN * float(np.quantile(np.abs(error), 0.95)), 1e-3)
    bars = 1e3 * np.stack([np.maximum(estimate - low, 0.0), np.maximum(high - estimate, 0.0)])
    held = (low <= truth) & (truth <= high)
    for which, color, text in ((held, "#1f4e79", "true value inside"), (~held, "#c55a11", "outside")):
        axes.errorbar(
            truth[which], np.clip(error[which], -edge, edge), bars[:, which], fmt=".", markersize=3,
            linewidth=0.6, color=color, label=f"{text}: {np.count_nonzero(which)}",
        )  # fmt: skip
    axes.axhline(0.0, color="0.5", linewidth=1)
    recordings = fresh[0]["summary"]["recordings"]
    axes.set(
        xlabel="true clearance [mm]", ylabel="error with its interval [µm]", ylim=(-1.3 * edge, 1.3 * edge)
    )
    axes.legend(loc="upper center", fontsize=8, ncols=2)
    axes.set_title(
        f"{recordings} new recordings: {np.abs(error).mean():.1f} µm mean error\n{name}", fontsize=10
    )
