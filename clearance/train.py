"""Train a model of the clearance: ``python -m clearance.train model=lstm sensors=rod``."""

import logging
import re
from collections.abc import Collection, Sequence
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from hydra.core.hydra_config import HydraConfig
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from clearance.commands import command
from clearance.configuration import CONFIGURATION, set_key
from clearance.errors import InputError
from clearance.evaluation.evaluate import evaluate
from clearance.models.estimator import Estimator
from clearance.models.gauge import Gauge
from clearance.models.run_folder import METRICS, RunFolder, environment
from clearance.models.seen import require_apart, require_same_division
from clearance.models.together import fit_together, shareable
from clearance.recording.bounds import whole
from clearance.whole_files import read_json
from clearance.windows.datamodule import WindowData

log = logging.getLogger(__name__)
_COMPUTES = ("trainer.progress", "trainer.threads", "trainer.accelerator")  # what any model may be given


@command("train")
def main(cfg: DictConfig) -> float | None:
    """Prepare the data, train, calibrate on the test recordings, judge, save; return the validation NMAE."""
    each = [cfg] if cfg.seeds is None else [of_seed(cfg, seed) for seed in different(cfg.seeds)]
    # Everything is checked before anything is written or computed.
    if not isinstance(cfg.resume, bool):
        raise InputError(f"resume = {cfg.resume!r} is neither true nor false; change resume")
    _require_read(cfg, {set_key(one) for one in HydraConfig.get().overrides.task})
    if "training" not in cfg.model:  # a network checks all of its trainer
        whole(cfg.trainer.get("threads"), "trainer.threads", 1, 1024, null=True)
    instantiate(cfg.sensors)
    data = instantiate(each[0].data, _convert_="all")
    estimators = [instantiate(one.model, _convert_="all") for one in each]
    estimators[0].check(data)
    instantiate(cfg.metrics)
    instantiate(cfg.calibration)
    if cfg.seeds is not None:
        shareable(estimators)
    runs = [open_run(one) for one in each]
    shared = None if cfg.seeds is None else open_run(cfg)
    finished = all(run.finished for run in runs)
    if not finished:  # what computes is nothing of what was trained
        estimators[0].check_devices()
    if cfg.begin is not None and not finished:  # what is finished needs its weights no more
        require_apart(Path(str(cfg.begin)), plain(cfg))
        for estimator in estimators:
            estimator.begin(Path(str(cfg.begin)))

    if not (finished and data.source.reproducible):
        try:
            data.prepare_data()
            data.setup()
        except InputError as error:
            if not finished:
                raise
            log.warning("its recordings cannot be read, so that nobody knows whether they changed: %s", error)
        else:
            if cfg.begin is not None and not finished:
                divided = len(data.recordings.lengths), data.recordings.fingerprint
                require_same_division(Path(str(cfg.begin)), plain(cfg), *divided)
            for run in runs:
                run.begin(data.recordings.fingerprint)
    if finished:
        for run in runs:
            log.info("%s is finished: resume=false trains again", run.path)
        if shared is not None:  # a kill after the last of them left what all shared
            shared.drop_checkpoints()
        return validation_error(runs)
    if shared is None:
        judge(cfg, estimators[0], data, runs[0], estimators[0].fit(data, runs[0]), 1)
        return validation_error(runs)
    shared.begin(data.recordings.fingerprint)
    seconds = fit_together(shareable(estimators), data, runs, shared)
    failed: list[str] = []
    for one, estimator, run, spent in zip(each, estimators, runs, seconds, strict=True):
        try:
            if not run.finished:
                judge(one, estimator, data, run, spent, len(runs))
        except InputError as error:  # the others are worth as much without it
            failed.append(f"seed={one.seed}: {error}")
    if failed:
        raise InputError("; ".join(failed))
    shared.drop_checkpoints()
    return validation_error(runs)


def _require_read(cfg: DictConfig, asked: Collection[str]) -> None:
    """Refuse what was asked for of data that have no such thing: it would change nothing.

    Args:
        cfg: the configuration.
        asked: keys that were set on the command line.

    Raises:
        InputError: something was.
    """
    source = cfg.data.source
    if "runs" in asked and "simulation" not in source:
        raise InputError(
            f"runs={cfg.runs}: a number of simulated runs, of which these data have none; leave it out, or "
            "with data=stored set data.source.runs"
        )
    if "start_time" in asked and "start_time" not in source and "simulation" not in source:
        raise InputError(
            f"start_time={cfg.start_time}: of stored and simulated runs; files are read whole; leave it out, "
            "and cut files that begin with a start"
        )
    unread = sorted(key for key in asked if key.startswith("trainer.") and key not in _COMPUTES)
    if unread and "training" not in cfg.model:
        log.warning("%s: of networks; what is trained here reads nothing of it", ", ".join(unread))
    of_runs = {"campaign", "data_seed", *_groups_of_machine()}
    for key in sorted(asked):
        if "simulation" not in source and key.split(".")[0] in of_runs:
            raise InputError(f"{key}: of simulated runs, of which these data have none; leave it out")
        if "held_out" in source and (key == "split_seed" or key.startswith("data.split")):
            raise InputError(
                f"{key}: nothing is divided where every epoch is simulated anew; leave it out, and set "
                "data.source.held_out for how many runs validate and test"
            )


def _groups_of_machine() -> set[str]:
    """Groups of configurations that decide what a simulated sensor shows."""
    defaults = OmegaConf.load(CONFIGURATION / "machine.yaml").defaults
    return {str(group) for one in defaults if OmegaConf.is_dict(one) for group in one}


def different(seeds: Any) -> list[int]:
    """Check the ``seeds`` to train together."""
    found = list(seeds) if OmegaConf.is_list(seeds) else []
    whole = all(type(seed) is int and 0 <= seed < 2**32 for seed in found)
    if not found or not whole or len(set(found)) < len(found):
        raise InputError(
            f"seeds={seeds}: must be a list of different whole numbers from 0 to {2**32 - 1}; set seeds"
        )
    return found


def of_seed(cfg: DictConfig, seed: int) -> DictConfig:
    """What a training with ``seed`` alone would have been asked for, in the folder that it would have had.

    Where the folder is not named by the overrides, it is one below that of all.
    """
    one = deepcopy(cfg)
    folder = str(cfg.folder)
    named = re.sub(r"(.*)\bseeds=\[[^\]]*\]", rf"\g<1>seed={seed}", folder)  # later overrides may hold a "/"
    one.seed, one.seeds = seed, None
    one.folder = named if named != folder else str(Path(folder) / f"seed={seed}")
    return one


def open_run(cfg: DictConfig) -> RunFolder:
    """The folder of a training, with its configuration and what was asked for."""
    asked = HydraConfig.get()
    config = {
        "experiment": asked.runtime.choices["experiment"],
        "chosen_model": asked.runtime.choices["model"], **plain(cfg),
        "overrides": list(asked.overrides.task),
    }  # fmt: skip
    return RunFolder.open(Path(str(cfg.folder)), config, cfg.seed, cfg.resume)


def plain(cfg: DictConfig) -> dict[str, Any]:
    """A configuration without interpolations."""
    content: Any = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
    return content


def judge(
    cfg: DictConfig, estimator: Estimator, data: WindowData, run: RunFolder, seconds: float, together: int
) -> None:
    """Calibrate and judge a trained estimator, and write the last of its run."""
    calibration, metrics = instantiate(cfg.calibration), instantiate(cfg.metrics)
    gauge = Gauge.calibrate(estimator, data, **asdict(calibration))
    gauge.save(run.path)
    validation = evaluate(gauge, data, data.validation_windows(), metrics)
    test = evaluate(gauge, data, data.test_windows(), metrics)
    for name, figure in test.figures(f"{cfg.name}, test recordings").items():
        run.logger.experiment.add_figure(f"test/{name}", figure, close=False)
    scores = {f"test/{name}": value for name, value in test.metrics.items()}
    run.compare(scores)
    run.finish(
        {
            "validation": validation.metrics,
            "test": test.metrics,
            "training_seconds": seconds,
            "trained_together": together,
            "evaluation_seconds": test.seconds,
            "parameters": estimator.parameters,
            "seed": cfg.seed,
            "split_seed": cfg.split_seed,
            "data": {"fingerprint": data.recordings.fingerprint, "recordings": len(data.recordings.lengths)},
            "environment": environment(*estimator.processors),
        }
    )
    log.info(
        "%s: mean error on %d test recordings %.1f µm a recording (%.2f %%), %.1f µm a window (%.2f %%); "
        "trained in %.0f s", run.path, len(data.parts.test),
        test.metrics["recording_nmae"] * 1e4 * cfg.clearance_range, test.metrics["recording_nmae"],
        test.metrics["nmae"] * 1e4 * cfg.clearance_range, test.metrics["nmae"], seconds,
    )  # fmt: skip
    if "location_accuracy" in test.metrics:
        log.info(
            "where clearance is was told rightly of %.1f %% of them; mean error a recording %.2f %% in B, "
            "%.2f %% in C", 100 * test.metrics["location_accuracy"], test.metrics["recording_nmae_b"],
            test.metrics["recording_nmae_c"],
        )  # fmt: skip


def validation_error(runs: Sequence[RunFolder]) -> float:
    """Mean NMAE on the validation windows: what a sweep compares."""
    return float(
        np.mean([read_json(run.path / METRICS, "resume=false")["validation"]["nmae"] for run in runs])
    )


if __name__ == "__main__":
    main()
