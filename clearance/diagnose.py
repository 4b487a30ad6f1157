"""Find what the model lacks: ``python -m clearance.diagnose 'recordings=[a.parquet,b.parquet]' joint=C``."""

import logging
import os
import sys
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from clearance.commands import command
from clearance.diagnosis.demonstration import demonstration
from clearance.diagnosis.effect import load_effects
from clearance.diagnosis.explain import Explanation
from clearance.diagnosis.hypothesis import Setting, gather
from clearance.diagnosis.measured import Measured, chain_of
from clearance.diagnosis.outcome import Outcome, diagnose
from clearance.diagnosis.report import write_report
from clearance.errors import InputError
from clearance.mechanism.description import write_mechanism
from clearance.models.run_folder import write_json
from clearance.recording.correction import corrected
from clearance.recording.files import read
from clearance.recording.recording import Recording

log = logging.getLogger(__name__)

JOINTS = ("B", "C")


@command("diagnose")
def main(cfg: DictConfig) -> None:
    """Diagnose recordings; write ``diagnosis.json``, ``report.html`` and ``corrected.yaml``."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    joint = str(cfg.joint.name)
    if joint not in JOINTS:
        raise InputError(
            f"joint={joint}: a diagnosis needs the joint that has the clearance; joint=B or joint=C"
        )
    setting = Setting(instantiate(cfg.mechanism, _convert_="all"), joint)
    hypotheses: Any = (
        OmegaConf.to_container(cfg.hypotheses) if OmegaConf.is_list(cfg.hypotheses) else cfg.hypotheses
    )
    effects = load_effects(hypotheses, list(cfg.without))
    groups = gather(effects, setting.with_clearance(3e-4), joint)
    low, high = (float(v) * 3.141592653589793 / 30.0 for v in cfg.speed_range)
    workers = cfg.workers or os.cpu_count() or 1
    channels = tuple(instantiate(cfg.sensors, _convert_="all").channels)
    if not cfg.recordings:
        log.info("no recordings given: a demonstration on a simulated machine with friction on its guide")
    fitted, judged = _load(cfg, setting, channels)

    def keep(explanation: Explanation) -> None:
        rows = [
            {"name": a.label, "misfit": a.misfit, "clearance_m": float(a.fit.values[0, 0])}
            for a in [explanation.nominal, *explanation.attempts]
        ]
        write_json(folder / "progress.json", rows)

    outcome = diagnose(
        fitted, judged, setting, groups, (low, high), workers, int(cfg.most_effects), log.info, keep
    )
    _write(folder, outcome)
    sys.stdout.write("\n" + "\n".join(outcome.diagnosis["summary"]) + "\n")
    log.info("verdict: %s; written to %s", outcome.diagnosis["verdict"], folder)


def _load(
    cfg: DictConfig, setting: Setting, channels: tuple[str, ...]
) -> tuple[list[Measured], list[Measured]]:
    """Recordings to fit and recordings to judge by."""
    if cfg.recordings:
        named = {str(path): corrected(read(Path(str(path)))) for path in cfg.recordings}
    else:
        named = demonstration(setting)
    others = {str(path): corrected(read(Path(str(path)))) for path in cfg.held_out}
    fitted, judged = [], []
    for name, recording in named.items():
        whole = Measured.of(_selected(recording, channels, name), chain_of(recording, name), name)
        if others:
            fitted.append(whole)
            continue
        cut = 2 * len(whole.values) // 3
        fitted.append(whole.part(0, cut))
        judged.append(whole.part(cut, len(whole.values)))
    for name, recording in others.items():
        judged.append(Measured.of(_selected(recording, channels, name), chain_of(recording, name), name))
    return fitted, judged


def _selected(recording: Recording, channels: tuple[str, ...], name: str) -> Recording:
    """The accelerations of the sensor set that are there, and an encoder."""
    wanted = [c for c in recording.channels if c in channels or c == "crank_angle"]
    if not any(c in channels for c in wanted):
        raise InputError(f"{name}: has none of the channels {list(channels)}; change sensors")
    return recording.select(wanted)


def _write(folder: Path, outcome: Outcome) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "diagnosis.json", outcome.diagnosis)
    write_mechanism(folder / "corrected.yaml", outcome.machine, "\n".join(outcome.diagnosis["summary"]))
    write_report(folder / "report.html", outcome.diagnosis, outcome.evidence)
    from torch.utils.tensorboard import SummaryWriter

    with SummaryWriter(str(folder)) as events:
        for attempt in [outcome.explanation.nominal, *outcome.explanation.attempts]:
            events.add_scalar(f"misfit/{attempt.label}", attempt.misfit)
            events.add_scalar(f"clearance/{attempt.label}", attempt.fit.values[0, 0])


if __name__ == "__main__":
    main()
