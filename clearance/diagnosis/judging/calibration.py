"""How suspicious the fitted machine itself looks: simulated, recorded and refitted as the recordings were.

The stored list (``searching.significance``) is of machines of one mechanism, at some speeds, by some sensors.
What is unusual for this mechanism at these speeds, rates and noises, its own simulations tell. Each is fitted
with nothing known but what was known of the recordings: clearance, speed, path and noise are found anew.

Reference: Davison & Hinkley 1997, Bootstrap Methods and their Application, section 4.2 (parametric
bootstrap).
"""

import time
from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE
from clearance.diagnosis.kinematics.agreement import aligned
from clearance.diagnosis.searching.nominal import refit_nominal
from clearance.diagnosis.searching.screening import screen
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.sensing.measured import Measured
from clearance.errors import InputError
from clearance.lanes import WIDTH
from clearance.recording.recording import Recording
from clearance.simulation.batch import Sampling, run_batch
from clearance.simulation.failure import Failure
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import State
from clearance.simulation.trajectory import rest_state

_SETTLE = 0.3  # s until a run has forgotten its start
_KICK = 0.5  # of the crank's speed, at most: by which each run starts otherwise
_STEP, _REFINED = 2e-6, 5  # s at most, and steps in one while a joint touches: finer than the diagnosis takes


def simulated_scores(
    search: Search, nominal: Attempt, speed_range: tuple[float, float], count: int
) -> np.ndarray:
    """Falls of the sum of squares that the best hypothesis promises where nothing is missing.

    An interruption ends it early.

    Args:
        search: of the recordings.
        nominal: the refitted nominal machine.
        speed_range: among which the speeds are looked for [rad/s].
        count: of simulations.

    Returns:
        (count,) or fewer, rising; infinite for a simulation that could not be refitted.
    """
    found: list[float] = []
    started = time.monotonic()
    try:
        for k in range(count):
            if k % WIDTH == 0:  # as many as run in lockstep are kept at a time
                some = range(k, min(k + WIDTH, count))
                runs = [
                    _runs(nominal, r, one, some, search.workers) for r, one in enumerate(search.recordings)
                ]
            found.append(_score(search, [run[k % WIDTH] for run in runs], speed_range))
            left = (time.monotonic() - started) / len(found) * (count - len(found))
            search.report(f"nothing missing, simulated: {len(found)} of {count}, {left:.0f} s left")
    except KeyboardInterrupt:
        search.report(f"interrupted: {len(found)} of {count} simulations count")
    return np.sort(np.array(found))


def _runs(
    nominal: Attempt, r: int, measured: Measured, numbers: range, workers: int
) -> list[Measured | None]:
    """What a recording might have been, had the fitted machine made it; ``None`` for a failed run.

    Each run depends on its number and the recording's alone.
    """
    machine, chain = nominal.model.machine(nominal.fit.values[r]), measured.chain
    generators = [np.random.default_rng([r, number]) for number in numbers]
    states = np.repeat(rest_state(machine)[None], len(numbers), axis=0)
    kicks = _KICK * np.array([generator.random() for generator in generators])
    states[:, State.CRANK_SPEED] += kicks * nominal.fit.values[r, -1] * np.pi / 30.0
    made: list[Measured | None] = [None] * len(numbers)

    def keep(k: int, outcome: np.ndarray | Failure) -> None:
        if isinstance(outcome, Failure):
            return
        noise = generators[k].normal(size=(len(outcome), len(measured.signals)))
        values = outcome[:, list(measured.signals)] + measured.sigma * noise
        values = np.clip(values, -measured.limits, measured.limits)
        recording = Recording(values, measured.channels, chain.rate)
        made[k] = Measured.of(recording, chain, f"{measured.name}, simulated")

    run_batch(
        [machine] * len(numbers), Integrator("runge_kutta_4", _STEP, _REFINED),
        Sampling(chain.base_rate, chain.filter(), _SETTLE, measured.seconds), keep, workers, states,
        any_laws=True,
    )  # fmt: skip
    return made


def _score(search: Search, made: Sequence[Measured | None], speed_range: tuple[float, float]) -> float:
    """What the best of all hypotheses promises beside the machine refitted to simulated recordings."""
    recordings = [one for one in made if one is not None]
    if len(recordings) < len(made):
        return np.inf
    machine = search.setting.with_clearance(SOME_CLEARANCE)
    try:
        again = Search(
            recordings, [aligned(one, machine, speed_range) for one in recordings], search.setting,
            search.groups, search.workers, lambda _: None,
        )  # fmt: skip
        again.trace()
        nominal = refit_nominal(again).nominal
        hints = screen(nominal, again.others(nominal), again.workers).singles
    except (InputError, np.linalg.LinAlgError):
        return np.inf
    return hints[0].gain if hints else 0.0
