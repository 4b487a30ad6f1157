"""Train a model of the clearance: ``python -m clearance.train model=lstm sensors=rod``."""

import logging
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from clearance.commands import command
from clearance.errors import InputError
from clearance.evaluation.evaluate import evaluate
from clearance.models.gauge import Calibration, Gauge
from clearance.models.run_folder import METRICS, RunFolder, environment
from clearance.whole_files import read_json

log = logging.getLogger(__name__)


@command("train")
def main(cfg: DictConfig) -> float | None:
    """Prepare the data, train, calibrate on the test recordings, judge, save; return the validation NMAE."""
    config: Any = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
    # Everything is checked before anything is written or computed.
    instantiate(cfg.sensors)
    data = instantiate(cfg.data, _convert_="all")
    estimator = instantiate(cfg.model, _convert_="all")
    metrics = instantiate(cfg.metrics)
    calibration = Calibration(**cfg.calibration)
    if cfg.begin is not None:
        if not (Path(cfg.begin) / METRICS).exists():
            raise InputError(f"begin={cfg.begin}: no finished training there; set begin to the folder of one")
        estimator.begin(Path(cfg.begin))

    run = RunFolder.open(Path(cfg.folder), config, cfg.seed, cfg.resume)
    if run.finished:
        log.info("%s is finished: resume=false trains again", run.path)
        return read_json(run.path / METRICS)["validation"]["nmae"]

    data.prepare_data()
    data.setup()
    seconds = estimator.fit(data, run)

    gauge = Gauge.calibrate(estimator, data, **asdict(calibration))
    gauge.save(run.path)
    validation = evaluate(gauge, data, data.validation_windows(), metrics)
    test = evaluate(gauge, data, data.test_windows(), metrics)
    for name, figure in test.figures(f"{cfg.name}, test recordings").items():
        run.logger.experiment.add_figure(f"test/{name}", figure, close=False)
    scores = {f"test/{name}": value for name, value in test.metrics.items()}
    run.compare(config, scores)
    run.finish(
        {
            "validation": validation.metrics,
            "test": test.metrics,
            "training_seconds": seconds,
            "evaluation_seconds": test.seconds,
            "parameters": estimator.parameters,
            "seed": cfg.seed,
            "split_seed": cfg.split_seed,
            "data": {"fingerprint": data.recordings.fingerprint, "recordings": len(data.recordings.lengths)},
            "environment": environment(),
        }
    )
    log.info(
        "%s: mean error on %d test recordings %.1f µm a recording (%.2f %%), %.1f µm a window (%.2f %%); "
        "trained in %.0f s", run.path, len(data.parts.test),
        test.metrics["recording_nmae"] * 1e4 * cfg.clearance_range, test.metrics["recording_nmae"],
        test.metrics["nmae"] * 1e4 * cfg.clearance_range, test.metrics["nmae"], seconds,
    )  # fmt: skip
    return validation.metrics["nmae"]


if __name__ == "__main__":
    main()
