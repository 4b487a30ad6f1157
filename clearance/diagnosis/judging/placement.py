"""Which sensors tell the clearance: what each set of channels leaves unknown of it, from the simulator alone.

The Fisher information of a window about the clearance, with the machine's state at the window's beginning and
its speed unknown, bounds what any estimator can read from it (Rao 1945, Bull. Calcutta Math. Soc. 37; the
choice of sensors by it: Kammer 1991, J. Guid. Control Dyn. 14(2)). Before the recording the clearance is
somewhere in its range, which a window that says nothing leaves as it is.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from tqdm import tqdm

from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.detectability import follower_on_path
from clearance.diagnosis.sensing.measured import SAMPLES
from clearance.diagnosis.shooting.elimination import eliminate
from clearance.diagnosis.shooting.stretch import Pass
from clearance.errors import InputError
from clearance.mechanism.joint import CLEARANCE_RANGE
from clearance.mechanism.parameters import require, require_list
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.sensors import SensorChain

_LOOSENESS = 1e-3  # of the process noise that a fit allows: here the simulator is the truth
_SILENT = 1e-6  # of the largest channel: what shows less shows nothing
_SLOWEST = 500.0  # Hz: of which the run before a window holds the filter's tails
_ABSOLUTE = np.sqrt(2.0 / np.pi)  # mean magnitude of a normal error over its standard deviation


@dataclass(frozen=True)
class Conditions:
    """What the machine does and how well its sensors are.

    Attributes:
        clearances: [m], equally likely.
        speeds: [rpm], equally likely.
        clearance_range: what is known of the clearance before the recording [m].
        speed_range: likewise of the speed [rpm].
        sensors: whose noise the channels have.
        chain: that filters and samples them.
        window: that is read at a time [s].

    Raises:
        InputError: sensors without noise, a window of less than 2 ms or more than 0.2 s, or a chain that is
            too slow for it.
    """

    clearances: Sequence[float]
    speeds: Sequence[float]
    clearance_range: tuple[float, float]
    speed_range: tuple[float, float]
    sensors: SensorChain
    chain: MeasurementChain
    window: float

    def __post_init__(self) -> None:
        for name, low, high in (("clearance", 1e-6, CLEARANCE_RANGE[1]), ("speed", 1.0, 20_000.0)):
            listed, span = getattr(self, f"{name}s"), getattr(self, f"{name}_range")
            count = len(listed) if isinstance(listed, Sequence) else 1
            require_list(self, max(count, 1), low, high, **{f"{name}s": listed})
            require_list(self, 2, 0.0, high, **{f"{name}_range": span})
            if not span[0] < span[1]:
                raise InputError(
                    f"Conditions.{name}_range = {list(span)} does not rise; change the key that ends in "
                    f"'{name}_range'"
                )
        require(self, 0.002, 0.2, window=self.window)
        least = max(_SLOWEST, SAMPLES / self.window)
        if self.chain.rate < least:
            raise InputError(
                f"chain: base_rate / decimation = {self.chain.rate:g} Hz is too slow: at least {least:g} Hz "
                f"are needed for a window of {self.window:g} s; change chain.base_rate, chain.decimation or "
                "conditions.window"
            )
        if not all(
            one.noise > 0.0 or one.noise_density > 0.0 for one in map(self.sensors.sensor, ACCELERATIONS)
        ):
            raise InputError(
                "sensor_chain: an accelerometer without noise tells everything; set sensor_chain=mems, "
                "sensor_chain.default.noise (0.01: of the channel's standard deviation) or "
                "sensor_chain.default.noise_density"
            )

    def noise(self, size: np.ndarray, rate: float) -> np.ndarray:
        """(channels,) standard deviations [m/s²] beside accelerations of such standard deviations.

        Where noise is a share, a channel that shows nothing has that of the others.
        """
        shown = size > _SILENT * size.max()
        size = np.where(shown, size, np.median(size[shown]))
        sensors = [self.sensors.sensor(name) for name in ACCELERATIONS]
        share = np.array([one.noise for one in sensors])
        return np.hypot(share * size, np.array([one.noise_density for one in sensors]) * np.sqrt(rate / 2.0))


def subsets(channels: Sequence[str], most: int) -> list[tuple[str, ...]]:
    """Every set of one to ``most`` of the channels, in their order."""
    return [chosen for size in range(1, most + 1) for chosen in combinations(channels, size)]


def expected_errors(
    setting: Setting,
    sets: Sequence[Sequence[str]],
    conditions: Conditions,
    workers: int | None = None,
    progress: bool = True,
) -> np.ndarray:
    """(sets, clearances, speeds) mean absolute error [m] that a window leaves at least.

    Args:
        setting: the machine and the joint, B or C.
        sets: channels, each set out of the accelerations.
        conditions: under which the machine runs.
        workers: threads; all cores if ``None``.
        progress: whether a bar shows it.

    Raises:
        InputError: if the machine does not run under one of the conditions.
    """
    places = [(c, v) for c in conditions.clearances for v in conditions.speeds]
    with ThreadPoolExecutor(workers) as pool:
        each = pool.map(lambda place: _errors_at(setting, sets, conditions, *place), places)
        bar = tqdm(each, total=len(places), unit="place", desc="informing", disable=not progress)
        found = list(bar)
    return np.array(found).T.reshape(len(sets), len(conditions.clearances), len(conditions.speeds))


def _errors_at(
    setting: Setting, sets: Sequence[Sequence[str]], conditions: Conditions, clearance: float, speed: float
) -> np.ndarray:
    """(sets,) the same at one clearance and speed, averaged over windows side by side."""
    model, values = setting.model(), np.array([clearance, speed])
    machine = model.machine(values)
    follower = follower_on_path(machine, chain=conditions.chain)
    measured = follower.measured
    noise = conditions.noise(measured.values.std(axis=(0, 1)), measured.chain.rate)
    follower.measured = replace(measured, sigma=noise)
    columns, _ = model.columns(values)
    seen = follower.look(machine, columns, looseness=_LOOSENESS, forces=False)
    steps = np.array([abs(model.step(values, i)) for i in range(len(values))])
    spans = np.array([np.ptp(conditions.clearance_range), np.ptp(conditions.speed_range)])
    known = np.diag(12.0 / spans**2)  # of a uniform draw
    # a segment at each end only lends its motion to the filtered samples of the window
    length = round(conditions.window * measured.chain.rate / SAMPLES) + 2
    starts = range(0, follower.segments - length + 1, length - 2)
    doubts = [seen.chart.doubt(follower.path.nodes[start]) for start in starts]
    errors = []
    for channels in sets:
        part = np.tile([name in channels for name in ACCELERATIONS], SAMPLES)
        left = [
            _information(seen, part, slice(start, start + length), doubt)[:-1, :-1] / np.outer(steps, steps)
            for start, doubt in zip(starts, doubts, strict=True)
        ]
        errors.append(np.mean([_ABSOLUTE * np.sqrt(np.linalg.inv(one + known)[0, 0]) for one in left]))
    return np.array(errors)


def _information(seen: Pass, part: np.ndarray, window: slice, doubt: np.ndarray) -> np.ndarray:
    """(P + 1, P + 1) inner products of what the states of a window cannot explain, by some channels."""
    flow, defect, inputs, own, _, held, jacobian, sensitivity, residual = (one[window] for one in seen.system)
    n, parameters, nv = len(flow), sensitivity.shape[2], jacobian.shape[3]
    gram = np.zeros((parameters + 1, parameters + 1))
    eliminate(
        flow, defect, inputs, own, doubt, held, np.ascontiguousarray(jacobian[:, :, part]),
        np.ascontiguousarray(sensitivity[:, part]), np.ascontiguousarray(residual[:, part]),
        np.zeros((n, nv, 3 * nv + parameters + 1)), gram, np.zeros((n, parameters)),
        np.zeros((0, part.sum())), np.ones((0, part.sum())),
    )  # fmt: skip
    return gram
