"""Which further recording would tell explanations apart that do equally well with these sensors.

The first explanation is taken for the truth. Its machine is run where it may be recorded next, and another
explanation is fitted to that by the sensors that would be there: state, speed, clearance and its own
parameters. What it leaves there is by how much the prices would differ on average. Of each recording a
stretch is followed, so that it grows with their number. Explanations are told apart where it is ``margin``,
which grows with the root of all samples.

Reference: Hunter & Reiner 1965, Technometrics 7(3), 307-323 (the experiment for which rival models, each
fitted, differ most).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, Attempt
from clearance.diagnosis.following.trace import followed_segments
from clearance.diagnosis.judging.detectability import follower_on_path
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.significance import separating
from clearance.diagnosis.sensing.measured import Measured
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError
from clearance.recording.channels import ACCELERATIONS

_SLOWER, _FASTER = 0.75, 1.33  # times the slowest and the fastest recording
_SCALES = ANNEALING[2:]  # of the noise, from coarse to fine
_ITERATIONS, _TOLERANCE = 6, 1e-2  # of the fit of another explanation at each
_MOST, _COUNTLESS = 100, 10**6  # recordings that anybody makes; above, no number tells more


@dataclass(frozen=True)
class Experiment:
    """Recordings that tell explanations apart.

    Attributes:
        recordings: how many it takes, on top of those that were made.
        speed_rpm: of the crank.
        channel: accelerometer that is recorded, too; ``None``: the same sensors do.
        other_speed: whether the speed is another one than that of the recordings.
    """

    recordings: int
    speed_rpm: float
    channel: str | None = None
    other_speed: bool = False

    def __str__(self) -> str:
        """In plain words."""
        what = f"at {self.speed_rpm:.0f} rpm" if self.other_speed else f"with {self.channel} too"
        if not self.other_speed and self.channel is None:
            what = "like these"
        number = "One further recording" if self.recordings == 1 else f"{self.recordings} further recordings"
        return f"{number} {what}"


def experiments(
    explanation: Explanation,
    rivals: Sequence[Attempt],
    recordings: Sequence[Measured],
    late: Callable[[], bool] = lambda: False,
) -> list[Experiment]:
    """What tells the first of the rivals from each other one, what takes least first.

    One thing is changed at a time: a sensor more, or another speed; or nothing.

    Args:
        explanation: that they belong to.
        rivals: attempts that do equally well; none of a wrong clock, which any other clock shows.
        recordings: that they explain.
        late: whether the time is over; what was found by then counts.
    """
    truth, *others = rivals
    speeds = truth.fit.values[:, -1]
    found = []
    for proposed in _proposed(np.abs(speeds), recordings[0].channels):
        if late():
            break
        speed = float(np.copysign(proposed.speed_rpm, speeds[0]))
        heard = {*recordings[0].channels, proposed.channel}
        try:
            run = _recorded(truth, speed, recordings[0], [c for c in ACCELERATIONS if c not in heard])
            left, samples = min(_left(other, speed, run) for other in others)
        except (InputError, np.linalg.LinAlgError):  # a machine that does not run there
            continue
        followed = followed_segments(run.measured, speed * np.pi / 30.0) / run.segments
        own = followed * len(heard & {*ACCELERATIONS}) / len(ACCELERATIONS)  # others are deaf in the run
        needed = separating(explanation, max(left, 0.0) * followed, samples * own)  # 0: lost at once
        found.append(replace(proposed, recordings=ceil(np.clip(needed, 1.0, _COUNTLESS))))
    return sorted(found, key=lambda one: one.recordings)


def advised(found: Sequence[Experiment], tried: bool = True) -> str:
    """The best of them in plain words; ``tried``: whether there was time for all."""
    if not found or found[0].recordings > _MOST:
        if not tried:
            return "There was no time to reckon which further recording would tell these explanations apart."
        if not found:
            return "Which further recording would tell these explanations apart could not be reckoned."
        return (
            "No other speed and no further accelerometer would tell these explanations apart with a hundred "
            "recordings."
        )
    return f"{found[0]} would tell these explanations apart."


def _proposed(speeds: np.ndarray, channels: Sequence[str]) -> Iterator[Experiment]:
    """One recording of each kind; at speeds [rpm] above zero."""
    yield Experiment(1, float(speeds[0]))
    for speed in (_SLOWER * speeds.min(), _FASTER * speeds.max()):
        yield Experiment(1, float(speed), other_speed=True)
    for channel in ACCELERATIONS:
        if channel not in channels:
            yield Experiment(1, float(speeds[0]), channel)


def _recorded(truth: Attempt, speed: float, measured: Measured, deaf: Sequence[str]) -> Follower:
    """A follower on what accelerometers would record of the true machine, without noise."""
    row = np.append(truth.fit.values[0, :-1], speed)
    filtered = measured.filtered
    noise = float(np.median(measured.sigma[:filtered] / measured.size[:filtered]))
    follower = follower_on_path(truth.model.machine(row), noise, measured.chain)
    values = follower.measured.seen(follower.measured.values, truth.model.instrument(row))
    recorded = values.reshape(-1, values.shape[2])
    follower.measured = replace(follower.measured, values=values, recorded=recorded)
    for channel in deaf:
        follower.measured = follower.measured.without(channel)
    return follower


def _left(other: Attempt, speed: float, run: Follower) -> tuple[float, int]:
    """What another explanation leaves of a recording, a robust sum of squares, and of how many samples."""
    follower, values = run.part(0, run.segments), np.append(other.fit.values[0, :-1], speed)[None]
    for scale in _SCALES:
        found = settle([follower], other.model, values, _ITERATIONS, _TOLERANCE, 1, scale=scale)
        values = found.values
    samples = sum(one.samples for one in found.passes)
    return found.level * samples, samples
