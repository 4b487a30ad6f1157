"""Turn finished trainings into tables: ``python -m clearance.evaluate``."""

import logging
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from clearance.benchmark import report
from clearance.commands import command
from clearance.errors import InputError
from clearance.evaluation.fresh import FRESH, evaluate_fresh
from clearance.evaluation.overview import overview
from clearance.evaluation.results import collect, markdown, put_between_marks
from clearance.models.run_folder import CONFIG, METRICS
from clearance.models.trusted import instantiate_trusted
from clearance.predict import load_gauge
from clearance.whole_files import read_json, read_yaml, write_atomically, write_json

log = logging.getLogger(__name__)


@command("evaluate")
def main(cfg: DictConfig) -> None:
    """Measure coverage on fresh recordings where asked, collect the rows, write tables and picture."""
    runs = Path(cfg.runs)
    if cfg.fresh:
        for metrics in sorted(runs.rglob(METRICS)):
            measure_coverage(metrics.parent, cfg.fresh)
    rows = collect(runs)
    log.info("%s", markdown(rows))
    if cfg.results is None:
        return
    results = Path(cfg.results)
    results.mkdir(parents=True, exist_ok=True)
    write_json(results / "trainings.json", rows)
    if cfg.picture:
        fresh = read_json(Path(cfg.picture) / FRESH, "picture")
        name = (read_yaml(Path(cfg.picture) / CONFIG) or {}).get("name", "")
        figure = overview(fresh, name)
        write_atomically(results / "overview.png", lambda file: figure.savefig(file, dpi=110))
    blocks = {"results": markdown(rows)}
    if Path(cfg.bench).exists():
        bench = read_json(Path(cfg.bench), "bench")
        write_json(results / "bench.json", bench)
        blocks["bench"] = report.markdown(bench)
    if cfg.readme:
        readme = Path(cfg.readme)
        text = readme.read_text(encoding="utf-8")
        for block, content in blocks.items():
            text = put_between_marks(text, block, content)
        write_atomically(readme, lambda file: file.write_text(text, encoding="utf-8"))


def measure_coverage(run: Path, recordings: int) -> None:
    """Write ``fresh.json`` beside a training unless it is there with as many recordings."""
    if (run / FRESH).exists() and read_json(run / FRESH)["summary"]["recordings"] >= recordings:
        return
    config: dict[str, Any] = read_yaml(run / CONFIG) or {}
    if "campaign" not in config or "target" not in config:
        raise InputError(f"{run / CONFIG}: no campaign there, so nothing fresh can be simulated; set fresh=0")
    campaign = instantiate_trusted(config["campaign"], str(run / CONFIG))
    log.info("%s: %d fresh recordings", run, recordings)
    write_json(run / FRESH, evaluate_fresh(load_gauge(run), campaign, config["target"], recordings).to_json())


if __name__ == "__main__":
    main()
