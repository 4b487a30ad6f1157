"""Which sensors tell the clearance: ``python -m clearance.placement joint=C``."""

import logging
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from hydra.core.hydra_config import HydraConfig
from hydra.utils import instantiate
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from clearance.commands import command, threads
from clearance.configuration import set_key, with_mechanism_path
from clearance.diagnosis.hypotheses.hypothesis import JOINTS, Setting
from clearance.diagnosis.judging.placement import Conditions, expected_errors, subsets
from clearance.errors import InputError
from clearance.evaluation.figures import best_of_each_size
from clearance.provenance import describe
from clearance.recording.bounds import whole
from clearance.recording.channels import ACCELERATIONS
from clearance.whole_files import write_atomically, write_json

log = logging.getLogger(__name__)
_UNUSED = {"integrator": "sensors are compared by Runge-Kutta's fourth order in steps of 10 µs"}
_SHOWN = 3  # sets of each size
_OWN = ("sensors", "most", "best", "workers", "conditions")  # of a ranking, which a training has not


@command("placement", resumes=False, unused=_UNUSED)
@threadpool_limits.wrap(limits=1, user_api="blas")
def main(cfg: DictConfig) -> None:
    """Rank the sets, show the best of each size, write ``placement.json`` and ``placement.png``."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    asked = list(HydraConfig.get().overrides.task)
    joint = str(cfg.joint.name)
    if joint not in JOINTS:
        raise InputError(
            f"joint={joint}: sensors are chosen for the clearance of one joint; joint=B or joint=C"
        )
    channels = instantiate(cfg.sensors, _convert_="all").channels
    other = [name for name in channels if name not in ACCELERATIONS]
    if other:
        raise InputError(f"sensors.channels: {other} are no accelerations; choose from {list(ACCELERATIONS)}")
    if not any(set_key(one) == "most" for one in asked):
        cfg.most = min(cfg.most, len(channels))
    for name, most in (("most", len(channels)), ("best", 999)):
        whole(cfg[name], name, 1, most)
    setting = Setting(instantiate(cfg.mechanism, _convert_="all"), joint)
    conditions: Conditions = instantiate(cfg.conditions, _convert_="all")
    sets = subsets(channels, cfg.most)
    log.info("%d sets of at most %d channels, joint %s", len(sets), cfg.most, joint)
    errors = expected_errors(setting, sets, conditions, threads(cfg.workers))
    order = np.argsort(errors.mean(axis=(1, 2)), kind="stable")
    ranking = [
        {"channels": list(sets[i]), "error_m": _short(errors[i].mean()), "at_m": _short(errors[i])}
        for i in order
    ]
    write_json(folder / "placement.json", {"joint": joint, **describe(conditions), "ranking": ranking})
    shown = best_by_size(ranking, _SHOWN)
    figure = best_of_each_size(
        [[(one["channels"], one["error_m"]) for one in group] for group in shown],
        f"What {conditions.window * 1e3:g} ms leave unknown of the clearance in joint {joint}",
    )
    write_atomically(folder / "placement.png", lambda file: figure.savefig(file, dpi=110))
    sys.stdout.write(table(shown) + "\n" + training(ranking[: cfg.best], asked) + "\n")
    log.info("written to %s", folder)


def _short(values: np.ndarray) -> Any:
    """To the digits that linear theory is worth."""
    return np.vectorize(lambda value: float(f"{value:.3g}"))(values).tolist()


def best_by_size(ranking: Sequence[dict[str, Any]], count: int) -> list[list[dict[str, Any]]]:
    """The first ``count`` sets of one channel, of two, and so on, from a ranking, the best first."""
    most = max(len(one["channels"]) for one in ranking)
    return [[one for one in ranking if len(one["channels"]) == size][:count] for size in range(1, most + 1)]


def table(groups: Sequence[Sequence[dict[str, Any]]]) -> str:
    """Micrometres for people, the best sets of each size."""
    lines = ["sensors  least error of a window  channels"]
    lines += [
        f"{len(one['channels']):>7}  {one['error_m'] * 1e6:>17.3g} µm  {', '.join(one['channels'])}"
        for group in groups
        for one in group
    ]
    return "\n".join(lines)


def training(ranking: Sequence[dict[str, Any]], asked: Sequence[str]) -> str:
    """The command that trains on each of some sets the machine that ``asked``, overrides, described."""
    sets = ",".join("[" + ",".join(one["channels"]) + "]" for one in ranking)
    kept = [with_mechanism_path(one) for one in asked if set_key(one).split(".")[0] not in _OWN]
    if not any(set_key(one) == "sensor_chain" for one in kept):
        kept.insert(0, "sensor_chain=mems")
    words = ["model=tcn", *kept, f"sensors.channels={sets}"]
    return f"to train on the best: python -m clearance.train -m {shlex.join(words)}"


if __name__ == "__main__":
    main()
