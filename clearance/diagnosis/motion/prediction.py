"""What a machine with ideal joints would have shown of its motion: sixteen guesses at a time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.motion.track import Track, respond
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.side_by_side import side_by_side
from clearance.lanes import WIDTH
from clearance.mechanism.parameters import PARAMETERS, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import aligned
from clearance.simulation.ideal import MOTIONS, WORK_ROWS, Motion, run_ideal
from clearance.simulation.integrator import Scheme
from clearance.simulation.layout import STATES, State

_TURN = 0.06  # rad of the crank in one step: error of the angle after a minute below that of an encoder
_LONGEST = 1e-3  # s
_SHORTEST = 5e-6  # s: a drive that needs shorter steps is stiffer than any that is meant, and is not run
_STIFF = 2.0  # step times the drive's rate; the scheme is stable up to 2.8


@dataclass(frozen=True)
class Guess:
    """A machine, its instruments, and how a recording began.

    Attributes:
        machine: joints ideal.
        instrument: gain, bias and delay of channels.
        angle: of the crank at the first sample [rad].
        speed: [rad/s].
        integral: of the drive's speed error [rad].
        clearance: radial [m], of the joint that ``slack`` is for.
        slack: ``Motion.SLACK_B`` or ``SLACK_C``.
    """

    machine: SliderCrank
    instrument: Instrument
    angle: float
    speed: float
    integral: float
    clearance: float = 0.0
    slack: int = int(Motion.SLACK_C)


def longest_step(p: np.ndarray, speed: float) -> float:
    """The step [s] at which the scheme is stable and as exact as an encoder, for parameters (PARAMETERS,)."""
    length = p[Parameter.ROD_TO_B] + p[Parameter.ROD_TO_C]
    lever = p[Parameter.CRANK_LENGTH] / length
    rod = 1.0 / p[Parameter.ROD_INVERSE_INERTIA] + p[Parameter.ROD_MASS] * p[Parameter.ROD_TO_C] ** 2
    inertia = 1.0 / p[Parameter.CRANK_INVERSE_INERTIA] + rod * lever**2  # least: at the dead centres
    rate = p[Parameter.DRIVE_PROPORTIONAL] / inertia
    return float(min(_LONGEST, _TURN / max(abs(speed), 1.0), _STIFF / max(rate, 1e-9)))


def predict(track: Track, guesses: Sequence[Guess], workers: int = 1) -> np.ndarray:
    """Signals of each guess, (guesses, samples, channels); not finite where a run failed."""
    keys = [tuple(guess.machine.codes()) for guess in guesses]
    groups = []
    for key in dict.fromkeys(keys):
        alike = [i for i, other in enumerate(keys) if other == key]
        groups += [alike[i : i + WIDTH] for i in range(0, len(alike), WIDTH)]
    found = np.empty((len(guesses), len(track.values), len(track.channels)))

    def work(group: list[int]) -> None:
        found[group] = _run(track, [guesses[i] for i in group])

    side_by_side(work, groups, workers)
    return found


def _run(track: Track, guesses: Sequence[Guess]) -> np.ndarray:
    count, fine = len(guesses), track.oversampling
    p, s, work = aligned(PARAMETERS), aligned(STATES), aligned(WORK_ROWS)
    for lane in range(WIDTH):
        guess = guesses[min(lane, count - 1)]
        p[:, lane] = guess.machine.parameters()
        s[State.CRANK_ANGLE, lane], s[State.CRANK_SPEED, lane] = guess.angle, guess.speed
        s[State.DRIVE_INTEGRAL, lane] = guess.integral
    fastest = max(max(abs(guess.speed) for guess in guesses), float(np.abs(p[Parameter.DRIVE_SPEED]).max()))
    steps = np.array([longest_step(p[:, lane], fastest) for lane in range(count)])
    lost = steps < _SHORTEST
    if lost.all():
        return np.full((count, len(track.values), len(track.channels)), np.nan)
    p[:, :count][:, lost] = p[:, [int(np.argmin(lost))]]
    step = float(steps[~lost].min())
    period = 1.0 / (track.rate * fine)
    substeps = max(1, int(np.ceil(period / step - 1e-9)))
    samples = (len(track.values) - 1) * fine + 1
    out = np.zeros((samples, MOTIONS, WIDTH))
    run_ideal(
        guesses[0].machine.codes(), p, s, work, int(Scheme.RUNGE_KUTTA_4), period / substeps, substeps, out
    )
    seen = np.empty((samples, count, len(track.channels)))
    delay = np.zeros((count, len(track.channels)))
    gain, bias = np.ones_like(delay), np.zeros_like(delay)
    for i, channel in enumerate(track.channels):
        seen[:, :, i] = out[:, Motion[channel.upper()], :count]
        for lane, guess in enumerate(guesses):
            if channel == "slider_position" and guess.clearance:
                seen[:, lane, i] += guess.clearance * out[:, guess.slack, lane]
            delay[lane, i] = guess.instrument.delay.get(channel, 0.0)
            gain[lane, i] = guess.instrument.gain.get(channel, 1.0)
            bias[lane, i] = guess.instrument.bias.get(channel, 0.0)
    filtered = np.array([channel != "crank_angle" for channel in track.channels])
    with np.errstate(all="ignore"):
        seen = respond(seen, track.rate * fine, track.low_pass, delay, filtered)[::fine]
        found = np.moveaxis(gain * seen + bias, 1, 0)
    found[lost] = np.nan
    return np.asarray(found)
