"""Least squares on the trajectory: every effect is fitted to the recordings' beginnings, the best one wins.

Single shooting: one run a recording, from one start (beside multiple shooting: Bock 1987, Bonner
Mathematische Schriften 183). Effects are compared by what they leave of the samples after the fitted ones.
"""

from typing import Any

import numpy as np
from scipy.optimize import least_squares

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.errors import InputError
from clearance.recording.channels import ACCELERATIONS
from clearance.simulation.layout import Signal
from clearance.trial.baselines.answer import answer, clearance_of, parameters
from clearance.trial.baselines.runs import ROUNDS, Bench, Fit, Values, named, spread

_GAIN = 0.05  # share of the squares after the fitted samples that an effect must explain


def judge(bench: Bench, effects: tuple[Effect, ...]) -> dict[str, Any]:
    """The effect that leaves least, if that is clearly less than the nominal machine leaves."""
    nominal = bench.nominal()
    base = _left(bench, nominal, None)
    tried = [
        (fit, effect, _left(bench, fit, effect))
        for effect in effects
        for fit, effect in _fits(bench, nominal, effect)
    ]
    best = min(tried, key=lambda one: one[2], default=None)
    gain = 0.0 if best is None else 1.0 - best[2] / base
    if best is None or gain < _GAIN:
        return answer(bench, clearance_of(nominal), [], detected=False, score=gain)
    fit, effect, _ = best
    found = named(effect, fit, len(bench.tracks))
    clearance = clearance_of(nominal if effect.kind == "instrument" else fit)
    return answer(bench, clearance, [(effect, parameters(effect, found))], detected=True, score=gain)


def _left(bench: Bench, fit: Fit, effect: Effect | None) -> float:
    (signals,) = bench.run([fit.values], effect)
    return float((bench.misfit(_seen(bench, signals, effect, fit), judged=True) ** 2).mean())


def _fits(bench: Bench, nominal: Fit, effect: Effect) -> list[tuple[Fit, Effect]]:
    channels = bench.tracks[0].channels
    fits = []
    for variant in effect.variants(channels):
        for start in list(variant.starts(bench.machine, bench.joint))[:1]:
            begin = np.append(nominal.values, [start[name] for name in variant.parameters])
            try:
                fit = (
                    _fault(bench, begin, variant)
                    if variant.kind == "instrument"
                    else bench.fit(begin, variant)
                )
            except InputError:  # a turned sensor whose other axis is not recorded
                continue
            fits.append((fit, variant))
    return fits


def _fault(bench: Bench, begin: Values, effect: Effect) -> Fit:
    """A fault of an instrument, on the nominal machine's signals as they are."""
    known = 1 + 2 * len(bench.tracks)
    (signals,) = bench.run([begin[:known]])
    low, high = np.array([parameter.bounds for parameter in effect.free], dtype=float).T

    def left(own: Values) -> np.ndarray:
        fit = Fit(np.append(begin[:known], own), 0.0, np.zeros(known + len(own)))
        return bench.misfit(_seen(bench, signals, effect, fit))

    low = np.where(np.isfinite(low), low, -1e9)
    high = np.where(np.isfinite(high), high, 1e9)
    scale = np.maximum(np.abs(begin[known:]), 1e-6)
    inside = np.clip(begin[known:], low + 1e-9 * scale, high - 1e-9 * scale)
    found = least_squares(left, inside, bounds=(low, high), x_scale=scale, max_nfev=ROUNDS)
    own = spread(found.jac, found.fun)
    return Fit(np.append(begin[:known], found.x), float(found.cost), np.append(np.zeros(known), own))


def _seen(bench: Bench, signals: list[np.ndarray], effect: Effect | None, fit: Fit) -> list[np.ndarray]:
    """Signals behind an instrument's fault."""
    if effect is None or effect.kind == "physics":
        return signals
    own = fit.values[1 + 2 * len(bench.tracks) :]
    faulty = effect.instrument(Instrument(), dict(zip(effect.parameters, map(float, own), strict=True)))
    seen = []
    for one, simulated in zip(bench.tracks, signals, strict=True):
        changed = simulated.copy()
        changed[:, : Signal.CRANK_ANGLE] = faulty.apply(
            simulated[:, : Signal.CRANK_ANGLE], ACCELERATIONS, one.rate
        )
        seen.append(changed)
    return seen
