"""Find what the model lacks: ``python -m clearance.diagnose 'recordings=[a.parquet,b.parquet]' joint=C``."""

import logging
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from math import inf, pi
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout
from hydra.core.hydra_config import HydraConfig
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from threadpoolctl import threadpool_limits

from clearance.commands import command, refuse, threads
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import JOINTS, Setting
from clearance.diagnosis.judging.outcome import SEARCHED, Outcome, diagnose
from clearance.diagnosis.judging.sensors import declared
from clearance.diagnosis.motion.attempt import Findings
from clearance.diagnosis.motion.outcome import diagnose as diagnose_motion
from clearance.diagnosis.motion.recordings import only_motion, tracks_of, uncertain_bounds, zero_is_known
from clearance.diagnosis.report import plain, write_events, write_report
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.significance import ENOUGH
from clearance.diagnosis.sensing.demonstration import CLEARANCE, demonstration
from clearance.diagnosis.sensing.measured import SAMPLES, Measured, chain_of, segments_before
from clearance.diagnosis.sensing.noise import still
from clearance.diagnosis.sensing.tolerances import NOTHING_LEFT_OPEN, Tolerances
from clearance.errors import InputError
from clearance.mechanism.description import write_mechanism
from clearance.mechanism.slider_crank import SliderCrank
from clearance.processes import RUNNING
from clearance.provenance import describe
from clearance.recording.bounds import whole
from clearance.recording.channels import OTHER_CHANNELS
from clearance.recording.correction import corrected
from clearance.recording.declaration import write_sensors
from clearance.recording.files import read, recordings_in
from clearance.recording.position import declared_positions, elsewhere, mounted
from clearance.recording.recording import Recording, at_one_rate
from clearance.whole_files import write_json

log = logging.getLogger(__name__)

UNKNOWN = "unknown"
UNUSED = {
    "integrator": "machines are run by Runge-Kutta's fourth order in steps of 10 µs or less",
    "chain": "a recording's own file says through which chain it went (key chain of NAME.yaml)",
    "sensor_chain": "what sensors do is found (tolerances says within which limits all may be off)",
}
"""What decides how a recording is simulated, and is not asked of one that was made."""
_NO_SENSORS = {"sensors": "without accelerometers every channel is used"}
_TOGETHER, _TOGETHER_IN_MOTION = 2, 5  # effects that are looked for at once: there a fit takes a second
_FASTEST = 20_000.0  # rpm
_MOST = 999  # simulations: some seconds each
_BESIDE = """What the accelerometers were found to do.
As NAME.yaml beside another recording NAME.parquet of theirs it is undone where that is read."""
_HELD_OUT = 1.0 / 3.0  # of each recording, where no other ones are held out


@command("diagnose", unused=UNUSED)
@threadpool_limits.wrap(limits=1, user_api="blas")  # its threads wait for each other busily where others work
def main(cfg: DictConfig) -> None:
    """Diagnose recordings; write ``diagnosis.json``, ``report.html`` and ``corrected.yaml``."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    try:
        with FileLock(folder / RUNNING, timeout=0):
            _diagnose(cfg, folder)
    except Timeout:
        raise InputError(
            f"hydra.run.dir = {folder}: another diagnosis is writing there; set hydra.run.dir to another"
        ) from None


def _diagnose(cfg: DictConfig, folder: Path) -> None:
    joint = str(cfg.joint.name)
    if joint not in (*JOINTS, UNKNOWN):
        raise InputError(
            f"joint={joint}: a diagnosis asks for the clearance of one joint; joint=B, joint=C or "
            f"joint={UNKNOWN}"
        )
    nominal = instantiate(cfg.mechanism, _convert_="all")
    settings = [Setting(nominal, one) for one in (JOINTS if joint == UNKNOWN else [joint])]
    hypotheses = _names("hypotheses", cfg.hypotheses)
    without = _names("without", cfg.without)
    effects = [effect.around(nominal) for effect in load_effects(hypotheses, without)]
    if not effects:
        raise InputError(f"hypotheses = {hypotheses}: nothing is left to try; change hypotheses or without")
    low, high = _speeds(cfg.speed_range)
    most = cfg.most_effects
    whole(most, "most_effects", 1, 6, null=True)
    limit, finished = _time_limit(cfg.time_limit), _finished(cfg.finished)
    simulations = _simulations(cfg.simulations)
    tolerances = _tolerances(cfg.tolerances)
    if simulations and tolerances != NOTHING_LEFT_OPEN:
        raise InputError(
            f"simulations = {simulations}: only machines whose accelerometers are exact are simulated; "
            "simulations=0, or tolerances=null"
        )
    workers = threads(cfg.workers) or os.cpu_count() or 1
    judging = _files("held_out", cfg.held_out)
    fitting = _files("recordings", cfg.recordings, judging)
    if judging and not fitting:
        raise InputError(
            f"held_out = {[str(file) for file in judging]} and recordings = []: nothing to fit; give "
            "recordings"
        )
    recordings, held_out = _read("recordings", fitting), _read("held_out", judging)
    _require_in_place({**recordings, **held_out}, nominal)

    def keep(explanation: Explanation | Findings) -> None:
        write_json(folder / "progress.json", plain(_tried(explanation)))

    outcome: Outcome[Explanation] | Outcome[Findings]
    if only_motion([*recordings.values(), *held_out.values()]):
        refuse(_NO_SENSORS)
        if joint == UNKNOWN:
            raise InputError(
                "joint=unknown: only accelerations tell the joints apart, and these recordings have none; "
                "joint=B or joint=C"
            )
        if simulations:
            raise InputError(
                f"simulations = {simulations}: only a diagnosis by accelerations is calibrated so, and these "
                "recordings have none; simulations=0"
            )
        if tolerances != NOTHING_LEFT_OPEN:
            raise InputError(
                f"tolerances = {cfg.tolerances}: these recordings have no accelerometers; tolerances=null"
            )
        outcome = diagnose_motion(
            *tracks_of(recordings, held_out),
            settings[0],
            effects,
            uncertain_bounds(cfg.uncertain, nominal),
            zero_is_known(cfg.encoder_zero),
            (low, high),
            SEARCHED * limit,
            workers,
            _TOGETHER_IN_MOTION if most is None else most,
            log.info,
            keep,
            finished,
        )
    else:
        for name, left in (("uncertain", None), ("encoder_zero", "known")):
            if cfg[name] != left:
                raise InputError(
                    f"{name} = {cfg[name]}: only of recordings without accelerometers, which these are not; "
                    f"{name}={'null' if left is None else left}"
                )
        channels = tuple(instantiate(cfg.sensors, _convert_="all").channels)
        if not recordings:
            log.info("no recordings given: a demonstration on a simulated machine with friction on its guide")
        recordings = recordings or demonstration(settings[0].with_clearance(CLEARANCE))
        fitted, judged = _load(recordings, held_out, channels, tolerances)
        outcome = diagnose(
            fitted, judged, settings, effects, (low, high), workers, _TOGETHER if most is None else most,
            log.info, keep,
            limit, finished, simulations,
        )  # fmt: skip
        outcome.diagnosis["warnings"][:0] = _unused({**recordings, **held_out}, channels)
    told = any(one.metadata.get("sensors") for one in (*recordings.values(), *held_out.values()))
    _write(folder, outcome, told)
    lines = [*outcome.diagnosis["summary"], *outcome.diagnosis["warnings"]]
    sys.stdout.write("\n" + "\n".join(lines) + "\n")
    log.info("verdict: %s; written to %s", outcome.diagnosis["verdict"], folder)


def _names(key: str, given: Any) -> list[str]:
    """One name, or a list of them."""
    names: list[Any] = (
        [given] if isinstance(given, str) else list(given) if OmegaConf.is_list(given) else [None]
    )
    if not all(isinstance(name, str) for name in names):
        raise InputError(f"{key} = {given!r} is no name or list of names; change {key}")
    return names


def _speeds(given: Any) -> tuple[float, float]:
    """The range of speeds [rad/s] from rpm."""
    values = list(given) if OmegaConf.is_list(given) else [given]
    numbers = [v for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(values) != 2 or len(numbers) != 2 or not 0.0 < numbers[0] < numbers[1] <= _FASTEST:
        raise InputError(
            f"speed_range = {values} is not two rising speeds above 0 and up to {_FASTEST:g} rpm; change "
            "speed_range"
        )
    return numbers[0] * pi / 30.0, numbers[1] * pi / 30.0


def _time_limit(given: Any) -> float:
    if given is None:
        return inf
    if isinstance(given, bool) or not isinstance(given, int | float) or not given > 0.0:
        raise InputError(f"time_limit = {given!r} is not a time above 0 s or null; change time_limit")
    return float(given)


def _simulations(given: Any) -> int:
    whole = isinstance(given, int) and not isinstance(given, bool)
    if not (whole and (given == 0 or ENOUGH <= given <= _MOST)):
        raise InputError(
            f"simulations = {given!r} is not 0 or a whole number from {ENOUGH} to {_MOST} (fewer support no "
            "p-value of 0.05); change simulations"
        )
    return int(given)


def _finished(given: Any) -> Path | None:
    if given is None:
        return None
    if not isinstance(given, str) or not given.strip():
        raise InputError(f"finished = {given!r} is not a folder or null; change finished")
    return Path(given)


def _tolerances(given: Any) -> Tolerances:
    if not (given is None or OmegaConf.is_dict(given)):
        raise InputError(
            f"tolerances = {given!r} is not null or limits such as {{gain: 0.02}}; change tolerances"
        )
    return Tolerances.given(given and OmegaConf.to_container(given))  # type: ignore[arg-type]


def _load(
    named: dict[str, Recording],
    others: dict[str, Recording],
    channels: tuple[str, ...],
    tolerances: Tolerances = NOTHING_LEFT_OPEN,
) -> tuple[list[Measured], list[Measured]]:
    """Recordings to fit and recordings to judge by, with the channels that say something in all of them."""
    everything = at_one_rate({**named, **others})
    shared = [
        c
        for c in next(iter(everything.values())).channels
        if (c in channels or c == "crank_angle") and all(c in r.channels for r in everything.values())
    ]
    apart = 0.0 if others else _HELD_OUT
    told = {name: segments_before(len(one.values), apart) for name, one in everything.items()}
    silent = {
        name: tuple(
            c
            for c in shared
            if told[name] and still(c, recording.channel(c)[: told[name] * SAMPLES], recording.rate)
        )
        for name, recording in everything.items()
    }
    heard = [c for c in shared if not any(c in mute for mute in silent.values())]
    if not any(c.startswith(("rod_", "slider_")) for c in heard):
        constant = f", of which {heard} say something" if len(heard) < len(shared) else ""
        raise InputError(
            f"recordings: share {shared} of the channels {list(channels)}{constant}; at least one on rod or "
            "slider is needed to follow the mechanism; change sensors or recordings"
        )
    measured = {
        name: replace(
            Measured.of(recording.select(heard), chain_of(recording, name), name, apart)
            .noised()
            .within(tolerances),
            silent=silent[name],
        )
        for name, recording in everything.items()
    }
    if others:
        return [measured[name] for name in named], [measured[name] for name in others]
    return (
        [measured[name].part(0, told[name]) for name in named],
        [measured[name].part(told[name], len(measured[name].values)) for name in named],
    )


def _unused(everything: dict[str, Recording], channels: tuple[str, ...]) -> list[str]:
    """What is said of channels that some recordings have and others lack, and of those that are not asked."""
    unasked = [
        c
        for c in OTHER_CHANNELS
        if c not in (*channels, "crank_angle") and all(c in one.channels for one in everything.values())
    ]
    lacking = {
        c: [name for name, one in everything.items() if c not in one.channels]
        for c in (*channels, "crank_angle")
    }
    left_out = [
        f"{c} is not in {' and '.join(names)} and was left out of all recordings"
        for c, names in lacking.items()
        if 0 < len(names) < len(everything)
    ]
    if unasked:
        left_out.append(
            f"{', '.join(unasked)}: not used beside accelerometers; sensors.channels=[...] with them says "
            "otherwise"
        )
    return left_out


def _files(key: str, paths: Any, held_out: Sequence[Path] = ()) -> list[Path]:
    """The recordings that a list of files and folders names; of a folder those that are not held out."""
    listed = [str(path) for path in (paths if OmegaConf.is_list(paths) else [paths])]
    apart = {file.resolve() for file in held_out}
    if "" in listed:
        raise InputError(f"{key} = {listed} names no file or folder; change {key}")
    found: list[Path] = []
    for path in map(Path, listed):
        if path.is_dir():
            inside = [file for file in recordings_in(path, key) if file.resolve() not in apart]
            if not inside:
                raise InputError(
                    f"{key}: every recording in {path} is held out, and none is left to fit; change {key} or "
                    "held_out"
                )
            found += inside
        elif path.resolve() in apart:
            raise InputError(
                f"{key}: {path} is held out as well, and cannot judge a fit to itself; change {key} or "
                "held_out"
            )
        else:
            found.append(path)
    _require_apart(key, found)
    return found


def _require_apart(key: str, files: Sequence[Path]) -> None:
    """Refuse a file that comes twice, and would count twice, and one whose name no report can say."""
    known: dict[Path, Path] = {}
    for file in files:
        try:
            str(file).encode()
        except UnicodeEncodeError:
            raise InputError(f"{key}: the name {str(file)!r} is no UTF-8; rename the file") from None
        if (other := known.setdefault(file.resolve(), file)) is not file:
            raise InputError(f"{key}: {file} and {other} are one file, which would count twice; change {key}")


def _read(key: str, files: Sequence[Path]) -> dict[str, Recording]:
    recordings = {}
    for file in files:
        try:
            recordings[str(file)] = read(file)
        except InputError as error:
            raise InputError(f"{key}: {error}") from error
        try:
            recordings[str(file)] = corrected(recordings[str(file)])
        except InputError as error:
            raise InputError(f"{key}: {file}: {error}") from error
    return recordings


def _require_in_place(recordings: dict[str, Recording], machine: SliderCrank) -> None:
    """Refuse a recording whose sensors are not where the machine has them."""
    known = mounted({"mechanism": describe(machine)})
    for name, recording in recordings.items():
        declared = declared_positions(recording)
        for channel in elsewhere(declared, known):
            raise InputError(
                f"{name}: sensor {channel} is at {declared[channel]:g} m, the machine has it at "
                f"{known[channel]:g} m; change mechanism.sensor_positions, or sensors.{channel}.position in "
                "the YAML beside it"
            )


def _write(
    folder: Path, outcome: Outcome[Explanation] | Outcome[Findings], declared_before: bool = False
) -> None:
    """Write what was found; what sensors do on top of what was declared is no declaration by itself."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "diagnosis.json").unlink(missing_ok=True)  # an earlier run's, beside which nothing new may lie
    write_mechanism(folder / "corrected.yaml", outcome.machine, "\n".join(outcome.diagnosis["summary"]))
    for outdated in folder.glob("events.out.tfevents.*"):  # TensorBoard would show both as one
        outdated.unlink()
    kept = bool(outcome.diagnosis.get("sensors")) and not declared_before
    if kept:
        write_sensors(folder / "sensors.yaml", declared(outcome.diagnosis["sensors"]), _BESIDE)
    else:  # an earlier run's are not this one's
        (folder / "sensors.yaml").unlink(missing_ok=True)
    evidence = plain({**outcome.evidence, "sensors_file": kept})
    write_report(folder / "report.html", outcome.diagnosis, evidence)
    write_events(folder, plain(outcome.diagnosis), evidence, _tried(outcome.explanation))
    # last: where it lies, the others do; a number that nobody knows is null
    write_json(folder / "diagnosis.json", plain(outcome.diagnosis))


def _tried(explanation: Explanation | Findings) -> list[dict[str, Any]]:
    """Everything that was fitted, with its clearance."""
    return [
        {"name": a.label, "misfit": a.misfit, "clearance_m": float(a.fit.values[0, 0])}
        for a in [explanation.nominal, *explanation.attempts]
    ]


if __name__ == "__main__":
    main()
