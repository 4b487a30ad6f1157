"""A two-sample test on summary features: could the fitted nominal simulator have made these revolutions?

Maximum mean discrepancy (Gretton et al. 2012, JMLR 13, 723-773) between features of the recordings'
revolutions and of simulated ones, as ``sbi`` computes it to warn of a misspecified simulator (Schmitt et al.
2023, arXiv:2112.08866). It can say that something is missing, not what.
"""

from importlib import import_module
from itertools import pairwise
from typing import Any

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.sensing.noise import noise_level
from clearance.errors import InputError
from clearance.simulation.layout import Signal
from clearance.trial.baselines.answer import answer
from clearance.trial.baselines.runs import Bench, Track

_RUNS = 64  # of the machine that resembles the recordings most
_CLEARANCES = np.geomspace(2e-5, 1.2e-3, 96)  # m, among which it is looked for
_AROUND = 0.05  # of its clearance, within which the runs differ: more than a step of the grid
_SPEEDS = 0.003  # likewise of its speed,
_NOISE = 0.1  # of its noise,
_ANGLES = 0.5  # rad, and of the crank's angle
_LEVEL = 0.05  # of the test
_BANDS = 4


def judge(bench: Bench, effects: tuple[Effect, ...]) -> dict[str, Any]:
    """Whether the test rejects the nominal machine at the clearance whose features are nearest.

    A recording counts as one observation: its revolutions are alike, and no independent draws.
    """
    draw = np.random.default_rng(0)
    recorded = np.stack([_features(one, one.values) for one in bench.tracks])
    aligned = np.array([value for one in bench.tracks for value in (one.speed, one.angle)])
    runs = bench.run([np.append(clearance, aligned) for clearance in _CLEARANCES])
    grid = np.array([_simulated(bench, run, draw) for run in runs])
    unit = np.nanstd(np.diff(grid, axis=0), axis=0) + 1e-12
    distances = ((grid - recorded) ** 2 / unit**2).mean(axis=(1, 2))
    best = float(_CLEARANCES[int(np.nanargmin(distances))])
    runs = bench.run([_varied(best, aligned, draw) for _ in range(_RUNS)])
    simulated = np.array([_simulated(bench, run, draw) for run in runs])
    simulated = simulated[np.isfinite(simulated).all(axis=(1, 2))]
    centre, scale = simulated.mean(axis=0), simulated.std(axis=0) + 1e-12
    chance = _p_value(
        (recorded - centre) / scale, ((simulated - centre) / scale).reshape(-1, recorded.shape[1])
    )
    return answer(bench, (best, None), [], detected=chance < _LEVEL, score=1.0 - chance)


def _varied(clearance: float, aligned: np.ndarray, draw: np.random.Generator) -> np.ndarray:
    moved = np.append(clearance * (1.0 + draw.uniform(-_AROUND, _AROUND)), aligned)
    moved[1::2] *= 1.0 + draw.uniform(-_SPEEDS, _SPEEDS, len(moved[1::2]))
    moved[2::2] += draw.uniform(-_ANGLES, _ANGLES, len(moved[2::2]))
    return moved


def _simulated(bench: Bench, run: list[np.ndarray], draw: np.random.Generator) -> np.ndarray:
    """(recordings, features) of a simulated run; not a number where it broke down."""
    return np.stack([
        _features(one, _noisy(one, signals, draw)) for one, signals in zip(bench.tracks, run, strict=True)
    ])  # fmt: skip


def _noisy(one: Track, signals: np.ndarray, draw: np.random.Generator) -> np.ndarray:
    columns = [int(Signal[c.upper()]) for c in one.channels]
    level = np.array([noise_level(one.values[:, k], column) for k, column in enumerate(columns)])
    level *= 1.0 + draw.uniform(-_NOISE, _NOISE, len(level))
    noisy: np.ndarray = signals[:, columns] + level * draw.normal(size=(len(signals), len(columns)))
    return noisy


def _features(one: Track, values: np.ndarray) -> np.ndarray:
    """(features,) by channel, mean over revolutions: mean, deviation, peak, kurtosis, power in bands."""
    length = round(2.0 * np.pi / one.speed * one.rate)
    turns = values[: len(values) // length * length].reshape(-1, length, values.shape[1])
    mean, deviation = turns.mean(axis=1), turns.std(axis=1)
    unit = (turns - mean[:, None]) / np.maximum(deviation, 1e-12)[:, None]
    power = np.abs(np.fft.rfft(turns, axis=1))[:, 1:] ** 2
    edges = np.geomspace(1, power.shape[1], _BANDS + 1).astype(int)
    bands = [np.log(power[:, a:b].sum(axis=1) + 1e-12) for a, b in pairwise(edges)]
    rows = [mean, deviation, np.abs(unit).max(axis=1), (unit**4).mean(axis=1), *bands]
    found: np.ndarray = np.concatenate(rows, axis=1).mean(axis=0)
    return found


def _p_value(recorded: np.ndarray, simulated: np.ndarray) -> float:
    try:
        test = import_module("sbi.diagnostics.misspecification").calc_misspecification_mmd
    except ImportError as error:
        raise InputError(
            "method = two_sample needs sbi; pip install '.[baselines]', or change method"
        ) from error
    torch = import_module("torch")
    torch.manual_seed(0)
    chance, _ = test(
        torch.tensor(recorded, dtype=torch.float32),
        torch.tensor(simulated, dtype=torch.float32),
        mode="x_space",
    )
    return float(chance)
