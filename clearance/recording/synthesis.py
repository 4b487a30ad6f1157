"""Simulated recordings: which machines run, and what their sensors write down.

Run ``i`` of a campaign depends on the seed and on ``i`` alone, so that shards, resumed and larger campaigns
agree.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from tqdm import tqdm

from clearance.errors import InputError
from clearance.mechanism.bearing import Worn
from clearance.mechanism.description import read_path, with_values
from clearance.mechanism.drive import Free
from clearance.mechanism.joint import CLEARANCE_RANGE
from clearance.mechanism.parameters import require, require_kind, require_list
from clearance.mechanism.slider_crank import SliderCrank
from clearance.provenance import describe, fingerprint, simulator
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS, OTHER_CHANNELS
from clearance.recording.dataset import Dataset
from clearance.recording.files import read, write
from clearance.recording.recording import Recording
from clearance.recording.sensors import SensorChain
from clearance.simulation.batch import Sampling, run_batch, simulate
from clearance.simulation.failure import Failure
from clearance.simulation.gpu.batch import require_gpu, run_batch_on_gpu
from clearance.simulation.integrator import Integrator
from clearance.simulation.stability import require_stable

log = logging.getLogger(__name__)
DEVICES = ("cpu", "cuda")
_CAMPAIGN = "campaign"  # whose fingerprint an exported recording carries in its metadata
_OPEN = 1.1  # times the lobes of a worn bore: where clearances begin

SIGNAL_CHANNELS = (*ACCELERATIONS, *OTHER_CHANNELS)
"""Channels in the order of the simulation's signals."""


@dataclass(frozen=True)
class ClearanceLocation:
    """Which joints' clearance is drawn: a member of the configuration group ``joint``.

    Attributes:
        name: of the option.
        b: whether B's is; ``None``: in a half of the runs, by chance.
        c: likewise of C, whatever B does.
    """

    name: str
    b: bool | None
    c: bool | None

    def __post_init__(self) -> None:
        for key in ("b", "c"):
            value = getattr(self, key)
            if not (value is None or isinstance(value, bool)):
                raise InputError(
                    f"joint.{key} = {value!r} of joint={self.name}: must be true, false or null (by chance); "
                    f"set joint.{key}"
                )


@dataclass(frozen=True)
class Campaign:
    """A set of simulated runs with clearance and speed drawn at random (paper, Section 2).

    Attributes:
        mechanism: the machine; its speed, and the clearance of ``joint``, are drawn anew for each run.
        joint: where the clearance is drawn; a joint in which it is not keeps the machine's own.
        integrator: scheme and steps.
        chain: measurement chain.
        sensors: imperfections of the sensors.
        runs: how many.
        seed: of all draws.
        clearance_range: of the uniform draw [m]; in a worn bore from 1.1 times its lobes on.
        speed_range: of the uniform draw of the speed that the drive is asked for [rpm].
        duration: of a simulation [s].
        record_start: time of the first recorded sample [s].
        random: path of a number of the machine, such as ``guide_friction.coulomb_force``, to the limits of
            its own uniform draw: physics that nobody knows.
        random_share: of the runs in which each of them is drawn, all if ``None``; in the others it is the
            machine's own.
        device: what simulates, ``cpu`` or ``cuda``; decides nothing but rounding, and what chaos makes of it.
    """

    mechanism: SliderCrank
    joint: ClearanceLocation
    integrator: Integrator
    chain: MeasurementChain
    sensors: SensorChain
    runs: int = 1000
    seed: int = 1
    clearance_range: Sequence[float] = (0.0, 1e-3)
    speed_range: Sequence[float] = (500.0, 1000.0)
    duration: float = 3.0
    record_start: float = 2.0
    random: Mapping[str, Sequence[float]] | None = None
    random_share: float | None = None
    device: str = "cpu"

    def __post_init__(self) -> None:
        require_kind(self, SliderCrank, mechanism=self.mechanism)
        require_kind(self, ClearanceLocation, joint=self.joint)
        require_kind(self, Integrator, integrator=self.integrator)
        require_kind(self, MeasurementChain, chain=self.chain)
        require_kind(self, SensorChain, "write sensor_chain=NAME on the command line", sensors=self.sensors)
        if isinstance(self.mechanism.drive, Free):
            raise InputError(
                "Campaign.mechanism.drive = Free: nothing turns a run, which begins at rest, at its label's "
                "speed; write drive=speed_control or drive=direct_current_motor, or change mechanism.drive"
            )
        if self.device not in DEVICES:
            raise InputError(
                f"Campaign.device = {self.device!r} is not one of {', '.join(DEVICES)}; change the key that "
                "ends in 'device'"
            )
        require(self, 1, 10_000_000, whole=True, runs=self.runs)
        require(self, 0, 2**63, whole=True, seed=self.seed)
        require(self, 0.0, 3600.0, strict=True, duration=self.duration)
        require(self, 0.0, self.duration, record_start=self.record_start)
        for name in ("duration", "record_start"):  # 3 and 3.0 are one campaign, and one fingerprint
            object.__setattr__(self, name, float(getattr(self, name)))
        require_list(self, 2, *CLEARANCE_RANGE, clearance_range=self.clearance_range)
        require_list(self, 2, 1.0, 20_000.0, speed_range=self.speed_range)
        for name in ("clearance_range", "speed_range"):
            low, high = limits = tuple(map(float, getattr(self, name)))
            object.__setattr__(self, name, limits)
            if low > high:
                raise InputError(
                    f"Campaign.{name} = [{low:g}, {high:g}] falls; change the key that ends in {name!r}"
                )
        if self.random_share is not None:
            require(self, 0.0, 1.0, random_share=self.random_share)
        given = {} if self.random is None else self.random
        if not isinstance(given, Mapping):
            raise InputError(
                f"Campaign.random = {given!r} is no mapping of the machine's numbers to limits, such as "
                "{gravity.1: [-9.81, 0]}; change the key that ends in 'random'"
            )
        drawn = {path: tuple(pair) if isinstance(pair, Sequence) else pair for path, pair in given.items()}
        object.__setattr__(self, "random", drawn)
        require_list(self, 2, -1e12, 1e12, **{f"random.{path}": pair for path, pair in drawn.items()})
        for path in drawn:
            if self._drawn_anyway(path) or not _is_number(read_path(self.mechanism, path)):
                raise InputError(
                    f"Campaign.random.{path} is no number of the machine that may be drawn; change the key "
                    "that ends in 'random'"
                )
            if drawn[path][0] > drawn[path][1]:
                raise InputError(
                    f"Campaign.random.{path} = {list(drawn[path])} falls; change the key that ends in "
                    "'random'"
                )
        self._require_open_bores()
        for end in (0, 1):
            extreme = with_values(self.mechanism, {path: float(pair[end]) for path, pair in drawn.items()})
            loose = {
                name: replace(getattr(extreme, name), clearance=self.clearance_range[1])
                for name, drawn_there in (("joint_b", self.joint.b), ("joint_c", self.joint.c))
                if drawn_there is not False
            }
            require_stable(replace(extreme, **loose), self.integrator.step)

    def _require_open_bores(self) -> None:
        """Refuse clearances that a worn bore's lobes would close: such a run has no machine."""
        for name, location in (("joint_b", self.joint.b), ("joint_c", self.joint.c)):
            key, least, lobes = "clearance_range", self.clearance_range[1], _OPEN * self._lobes(name)
            if location is False:
                key, (least, most) = "random", (self.random or {}).get(f"{name}.clearance", (0.0, 0.0))
                lobes = self._lobes(name) if most > 0.0 else 0.0
            if least <= lobes and lobes > 0.0:
                raise InputError(
                    f"clearance of {name}: {least:g} m, must be above {lobes:g} m, or the lobes of its bore "
                    f"close it; set bearing.amplitude below it, or change the key that ends in {key!r}"
                )

    def _lobes(self, name: str) -> float:
        """How far those of a joint's bore may reach in [m]; 0 where it is round."""
        bearing = getattr(self.mechanism, name).bearing
        if not isinstance(bearing, Worn):
            return 0.0
        return max(bearing.amplitude, *(self.random or {}).get(f"{name}.bearing.amplitude", (0.0,)))

    @property
    def sampling(self) -> Sampling:
        """Which samples a run records."""
        length = self.duration - self.record_start
        return Sampling(self.chain.base_rate, self.chain.filter(), self.record_start, length)

    @property
    def fingerprint(self) -> str:
        """Of all settings that decide what a run holds; the number of runs and the device do not."""
        return fingerprint(self.settings)

    @property
    def folder(self) -> str:
        """Name of a data set that nobody named: by the settings, and by the simulator that runs them."""
        return fingerprint([self.fingerprint, simulator()])

    @property
    def settings(self) -> dict[str, Any]:
        """A description of the campaign for people and for comparison."""
        described = describe(self)
        described.pop("runs")
        described.pop("device")
        if not self.random:
            described.pop("random")
            described.pop("random_share")
        return described

    def labels(self, runs: Sequence[int]) -> np.ndarray:
        """(runs, 3) clearance of B and C [m], and the speed that the drive is asked for [rad/s].

        A motor at constant voltage is asked for its no-load speed, and turns more slowly. In a worn bore
        clearances begin where its lobes leave some.
        """
        low, high = self.clearance_range
        low_b, low_c = (max(low, _OPEN * self._lobes(name)) for name in ("joint_b", "joint_c"))
        slow, fast = self.speed_range
        unknown = any(path.endswith(".clearance") for path in self.random or ())
        values = np.zeros((len(runs), 3))
        for row, run in enumerate(runs):
            draw = np.random.default_rng([self.seed, run]).uniform(size=3)
            drawn_b, drawn_c = low_b + draw[0] * (high - low_b), low_c + draw[1] * (high - low_c)
            nominal = self._nominal(run) if unknown else self.mechanism
            at_b, at_c = self._location(run)
            values[row, 0] = drawn_b if at_b else nominal.joint_b.clearance
            values[row, 1] = drawn_c if at_c else nominal.joint_c.clearance
            values[row, 2] = (slow + draw[2] * (fast - slow)) * np.pi / 30.0
        return values

    def machine(self, run: int) -> SliderCrank:
        """The machine of one run."""
        clearance_b, clearance_c, speed = self.labels([run])[0]
        nominal = self._nominal(run)
        return replace(
            nominal,
            joint_b=replace(nominal.joint_b, clearance=float(clearance_b)),
            joint_c=replace(nominal.joint_c, clearance=float(clearance_c)),
            drive=nominal.drive.at_speed(float(speed * 30.0 / np.pi)),
        )

    def _location(self, run: int) -> tuple[bool, bool]:
        """Whether the clearance of B and that of C are drawn in a run."""
        at_b, at_c = self.joint.b, self.joint.c
        if at_b is None or at_c is None:
            # A generator of its own: whatever is left to chance, the other draws stay.
            chance = np.random.default_rng([self.seed, run, 3]).uniform(size=2) < 0.5
            at_b = bool(chance[0]) if at_b is None else at_b
            at_c = bool(chance[1]) if at_c is None else at_c
        return at_b, at_c

    def _nominal(self, run: int) -> SliderCrank:
        """The machine with what is random of it, before clearance and speed."""
        if not self.random:
            return self.mechanism
        draw = np.random.default_rng([self.seed, run, 2]).uniform(size=(len(self.random), 2))
        values = {
            path: float(low + place * (high - low))
            for (place, chance), (path, (low, high)) in zip(draw, sorted(self.random.items()), strict=True)
            if self.random_share is None or chance < self.random_share
        }
        return with_values(self.mechanism, values)

    def _drawn_anyway(self, path: str) -> bool:
        drawn = {
            "joint_b.clearance": self.joint.b is not False,
            "joint_c.clearance": self.joint.c is not False,
        }
        return drawn.get(path, path in ("drive.speed_rpm", "drive.no_load_rpm"))

    def observe(self, run: int, signals: np.ndarray, channels: tuple[str, ...] = ACCELERATIONS) -> np.ndarray:
        """What the sensors make of a run's first channels, (samples, channels)."""
        ideal = Recording(signals[:, : len(channels)], channels, self.chain.rate, self.record_start)
        return self.sensors.apply(ideal, np.random.default_rng([self.seed, run, 1])).values

    def recording(self, run: int, signals: np.ndarray | None = None) -> Recording:
        """One run as a recording with all channels and the truth in its metadata.

        Args:
            run: its number.
            signals: (samples, 15) if they have been simulated already.
        """
        if signals is None:
            signals = simulate(self.machine(run), self.integrator, self.sampling)
        clearance_b, clearance_c, speed = (float(value) for value in self.labels([run])[0])
        metadata = {
            "chain": describe(self.chain),
            "truth": {"clearance_b": clearance_b, "clearance_c": clearance_c, "speed": speed},
        }
        observed = self.observe(run, signals.copy(), SIGNAL_CHANNELS)
        return Recording(observed, SIGNAL_CHANNELS, self.chain.rate, self.record_start, metadata)

    def generate(
        self, path: str | Path, shard: tuple[int, int] = (1, 1), workers: int | None = None
    ) -> Dataset:
        """Simulate what is not on disk yet; whatever stops it, calling it again goes on.

        Args:
            path: folder of the data set.
            shard: (k, n): every n-th run, beginning with the k-th.
            workers: threads; all cores if ``None``.
        """
        part, parts = shard
        if not 1 <= part <= parts:
            raise InputError(f"shard = {part}/{parts} must be k/n with 1 <= k <= n")
        self._require_device()
        sampling = self.sampling
        dataset = Dataset.create(
            path,
            self.labels(range(self.runs)),
            ACCELERATIONS,
            sampling.samples,
            sampling.rate,
            self.record_start,
            self.fingerprint,
            self.settings,
            simulator(),
        )
        missing = [run for run in dataset.missing().tolist() if run < self.runs and run % parts == part - 1]
        lock = Lock()
        with tqdm(
            total=len(missing), unit="run", desc="simulating", disable=not missing, mininterval=0.5
        ) as bar:

            def store(index: int, outcome: np.ndarray | Failure) -> None:
                run = missing[index]
                if isinstance(outcome, Failure):
                    dataset.write_failure(run, str(outcome))
                else:
                    dataset.write(run, self.observe(run, outcome))
                with lock:
                    bar.update()

            self._simulate(missing, store, workers)
        return dataset

    def export(
        self, folder: str | Path, shard: tuple[int, int] = (1, 1), workers: int | None = None
    ) -> list[Path]:
        """Write runs as Parquet recordings with all channels, as a logger would have left them.

        Runs that are there already stay; one that fails is told and left out.

        Args:
            folder: of the recordings.
            shard: (k, n): every n-th run, beginning with the k-th.
            workers: threads; all cores if ``None``.

        Returns:
            The recordings that are there.

        Raises:
            InputError: a recording of another campaign is in the place of one.
        """
        self._require_device()
        place, (part, parts) = Path(folder), shard
        paths = {run: place / f"run-{run:06d}.parquet" for run in range(part - 1, self.runs, parts)}
        own = self.fingerprint
        for path in paths.values():
            if path.exists() and read(path).metadata.get(_CAMPAIGN) != own:
                raise InputError(
                    f"recordings={folder}: {path} is of other settings, or of an older version; set "
                    "recordings to another folder"
                )
        place.mkdir(parents=True, exist_ok=True)
        missing = [run for run, path in paths.items() if not path.exists()]

        def store(index: int, outcome: np.ndarray | Failure) -> None:
            run = missing[index]
            if isinstance(outcome, Failure):
                log.warning("run %d is left out: %s", run, outcome)
                return
            recording = self.recording(run, outcome)
            write(replace(recording, metadata={**recording.metadata, _CAMPAIGN: own}), paths[run])

        self._simulate(missing, store, workers)
        return [path for path in paths.values() if path.exists()]

    def fresh(self, runs: int, epoch: int, channels: Sequence[str]) -> tuple[list[np.ndarray], np.ndarray]:
        """Runs that no data set holds: epoch ``e`` continues after ``runs`` times ``e`` others.

        Args:
            runs: of an epoch.
            epoch: its number; negative ones are of no training.
            channels: accelerations that are kept.

        Returns:
            A list of (samples, channels) float32 signals and their (runs, 3) labels; failed runs are left
            out.
        """
        columns = [ACCELERATIONS.index(name) for name in channels]
        offset = 1_000_000_000 + epoch * runs  # beyond every data set's runs
        wanted = range(offset, offset + runs)
        kept: dict[int, np.ndarray] = {}

        def keep(index: int, outcome: np.ndarray | Failure) -> None:
            if not isinstance(outcome, Failure):
                kept[index] = self.observe(wanted[index], outcome)[:, columns].astype(np.float32)

        self._simulate(wanted, keep, None)
        order = sorted(kept)
        return [kept[index] for index in order], self.labels([wanted[index] for index in order])

    def _simulate(
        self, runs: Sequence[int], sink: Callable[[int, np.ndarray | Failure], None], workers: int | None
    ) -> None:
        machines = [self.machine(run) for run in runs]
        if self.device == "cpu":
            run_batch(machines, self.integrator, self.sampling, sink, workers)
        else:
            run_batch_on_gpu(machines, self.integrator, self.sampling, sink, workers)

    def _require_device(self) -> None:
        """Refuse before anything is written."""
        if self.device != "cpu":
            require_gpu()


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
