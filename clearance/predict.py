"""Estimate clearances: ``python -m clearance.predict checkpoint=RUN recordings=FOLDER``."""

import logging
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from clearance.commands import command
from clearance.errors import InputError
from clearance.models.gauge import Estimate, Gauge
from clearance.models.location import LOCATIONS, location
from clearance.models.run_folder import CONFIG
from clearance.models.trusted import instantiate_trusted
from clearance.recording.correction import corrected
from clearance.recording.files import read, recordings_in
from clearance.recording.position import declared_positions
from clearance.whole_files import read_yaml, write_json

log = logging.getLogger(__name__)


@command("predict", resumes=False)
def main(cfg: DictConfig) -> None:
    """Read the gauge and the recordings, estimate each, show a table and write ``predictions.json``."""
    gauge = load_gauge(Path(str(cfg.checkpoint)))
    files = files_of(cfg.recordings)
    output = Path(str(cfg.output))
    if output.is_dir():
        raise InputError(f"output={output}: is a folder; set output to a file in it")
    found = {str(file): estimate_file(gauge, file) for file in files}
    output.parent.mkdir(parents=True, exist_ok=True)
    write_json(output, [{"path": path, **asdict(one)} for path, each in found.items() for one in each])
    sys.stdout.write(table(found, gauge.intervals[0].coverage) + locations(found))
    log.info("written to %s", output)


def files_of(recordings: Any) -> list[Path]:
    """The files that ``recordings`` names, one or a list; of a folder all recordings in it, by name."""
    paths = [Path(str(one)) for one in (recordings if OmegaConf.is_list(recordings) else [recordings])]
    if not paths:
        raise InputError("recordings=[]: at least one file is needed; set recordings")
    return [
        file for path in paths for file in (recordings_in(path, "recordings") if path.is_dir() else [path])
    ]


def load_gauge(folder: Path) -> Gauge:
    """The gauge that ``clearance.train`` left in ``folder``."""
    config = read_yaml(folder / CONFIG)
    model: Any = (config or {}).get("model")
    if not isinstance(model, dict):
        raise InputError(
            f"checkpoint={folder}: no configuration of a model there; set checkpoint to a training's folder"
        )
    return Gauge.load(instantiate_trusted(model, str(folder / CONFIG)), folder)


def estimate_file(gauge: Gauge, path: Path) -> tuple[Estimate, ...]:
    """Estimate one file, a clearance a joint; errors name it."""
    recording = read(path)
    try:
        missing = [name for name in gauge.channels if name not in recording.channels]
        if missing:
            raise InputError(
                f"lacks the channels {missing}: the model reads {list(gauge.channels)}; name them in the "
                "YAML beside the file, or train with sensors that are there"
            )
        signals = corrected(recording, gauge.channels).values
        return gauge.estimate(
            signals, recording.rate, recording.metadata.get("chain"), declared_positions(recording)
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def table(found: dict[str, tuple[Estimate, ...]], coverage: float) -> str:
    """Millimetres for people, one line a recording and joint."""
    interval = f"{coverage * 100:g}% interval mm"
    head = ("recording", "joint", "clearance mm", interval, "spread mm", "windows", "trusted")
    rows = [
        (
            path,
            one.joint,
            f"{one.clearance_m * 1e3:.4f}",
            f"{one.low_m * 1e3:.4f} - {one.high_m * 1e3:.4f}",
            f"{one.spread_m * 1e3:.4f}",
            str(one.windows),
            "yes" if one.trusted else f"no: {one.reason}",
        )
        for path, each in found.items()
        for one in each
    ]
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in [head, *rows]
    ]
    return "\n".join(lines) + "\n"


def locations(found: dict[str, tuple[Estimate, ...]]) -> str:
    """A line a recording that says which joints have clearance; none where the model takes it for granted."""
    said = {
        path: [one.has_clearance for one in each if one.has_clearance is not None]
        for path, each in found.items()
    }
    return "".join(
        f"{path}: clearance in {LOCATIONS[int(location(loose))]}\n" for path, loose in said.items() if loose
    )


if __name__ == "__main__":
    main()
