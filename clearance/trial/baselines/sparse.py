"""Sparse regression of the discrepancy: which functions of the nominal motion are in what it leaves?

The residual acceleration of each channel is regressed on a library of functions of the nominal motion by
sequentially thresholded least squares (Brunton, Proctor, Kutz 2016, PNAS 113(15), 3932-3937; discrepancies:
Kaheman et al. 2019, arXiv:1909.08574), as ``pysindy`` does it. The term that explains most names the effect.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.errors import InputError
from clearance.simulation.layout import Signal
from clearance.trial.baselines.answer import answer, clearance_of
from clearance.trial.baselines.runs import Bench, Track

_SMOOTH = 2e-3  # s, over which both sides are averaged: impacts come at other instants in the recording
_THRESHOLD = 0.1  # coefficients below are zero; both sides have standard deviation one
_GAIN = 0.05  # share of the residual's squares, in samples that were not fitted, that a model must explain
_OF_TERMS: Mapping[str, str] = {
    "own signal": "sensor_gain", "own rate": "sensor_delay", "other axis": "sensor_misalignment",
    "one": "sensor_bias", "sign of the slider's velocity": "guide_friction",
    "slider's velocity": "guide_friction", "slider's position": "slider_spring",
    "sine 1": "gravity", "cosine 1": "gravity",
} | {f"{wave} {k}": "torque_ripple" for wave in ("sine", "cosine") for k in (2, 3, 4, 5, 6)}  # fmt: skip


def judge(bench: Bench, effects: tuple[Effect, ...]) -> dict[str, Any]:
    """The effect that the strongest term of the best model stands for."""
    nominal = bench.nominal()
    (signals,) = bench.run([nominal.values])
    best: tuple[float, str, str] = (0.0, "", "")
    for channel in bench.tracks[0].channels:
        best = max(best, _model(bench, signals, channel))
    gain, channel, term = best
    clearance = clearance_of(nominal)
    if gain < _GAIN:
        return answer(bench, clearance, [], detected=False, score=gain)
    by_name = {effect.name: effect for effect in effects}
    effect = by_name.get(_OF_TERMS[term])
    if effect is None:
        body, direction = channel.split("_", 1)[0], channel.rsplit("_", 1)[1]
        return answer(bench, clearance, [], detected=True, place=(body, direction), score=gain)
    chosen = effect.on_channel(channel) if effect.each_channel else effect
    return answer(bench, clearance, [(chosen, {})], detected=True, score=gain)


def _model(bench: Bench, signals: list[np.ndarray], channel: str) -> tuple[float, str, str]:
    """Share of a channel's unseen residual that its sparse model explains, the channel, the main term."""
    fitted, judged = [], []
    for one, simulated in zip(bench.tracks, signals, strict=True):
        terms, left = _library(one, simulated, channel)
        fitted.append((terms[: one.fitted], left[: one.fitted]))
        judged.append((terms[one.fitted :], left[one.fitted :]))
    terms, left = (np.concatenate(part) for part in zip(*fitted, strict=True))
    scale = np.maximum(np.sqrt((terms**2).mean(axis=0)), 1e-12)
    size = max(float(left.std()), 1e-12)
    model = _regression()(threshold=_THRESHOLD)
    model.fit(terms / scale, (left / size)[:, None])
    weights = np.ravel(model.coef_)
    unseen, rest = (np.concatenate(part) for part in zip(*judged, strict=True))
    explained = unseen / scale @ weights * size
    gain = 1.0 - float(((rest - explained) ** 2).mean() / max((rest**2).mean(), 1e-24))
    return gain, channel, list(_OF_TERMS)[int(np.abs(weights).argmax())]


def _library(one: Track, simulated: np.ndarray, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """(samples, terms) of the nominal motion, and (samples,) residual of a channel, both smooth."""
    column = int(Signal[channel.upper()])
    own, angle = simulated[:, column], simulated[:, Signal.CRANK_ANGLE]
    place, velocity = simulated[:, Signal.SLIDER_POSITION], simulated[:, Signal.SLIDER_VELOCITY]
    waves = {f"sine {k}": np.sin(k * angle) for k in range(1, 7)}
    waves |= {f"cosine {k}": np.cos(k * angle) for k in range(1, 7)}
    columns = {
        "own signal": own, "own rate": np.gradient(own) * one.rate, "other axis": simulated[:, column ^ 1],
        "one": np.ones(len(own)), "sign of the slider's velocity": np.sign(velocity),
        "slider's velocity": velocity, "slider's position": place - place.mean(), **waves,
    }  # fmt: skip
    width = max(1, round(_SMOOTH * one.rate))
    terms = np.stack([columns[name] for name in _OF_TERMS], axis=1)
    left = one.values[:, one.channels.index(channel)] - own
    return uniform_filter1d(terms, width, axis=0), uniform_filter1d(left, width)


def _regression() -> Any:
    try:
        return import_module("pysindy").STLSQ
    except ImportError as error:
        raise InputError(
            "method = sparse needs pysindy; pip install '.[baselines]', or change method"
        ) from error
