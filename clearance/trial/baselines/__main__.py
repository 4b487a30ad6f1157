"""What one baseline makes of recordings: ``python -m clearance.trial.baselines method=sparse``."""

import logging
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from hydra.utils import instantiate
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits

from clearance.commands import command
from clearance.diagnose import UNUSED
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.errors import InputError
from clearance.recording.correction import corrected
from clearance.recording.files import read
from clearance.trial.baselines import sparse, trajectory, two_sample
from clearance.trial.baselines.runs import FIT, JUDGED, Bench
from clearance.whole_files import write_json

log = logging.getLogger(__name__)

METHODS = {
    "trajectory": (trajectory.judge, FIT + JUDGED),
    "sparse": (sparse.judge, FIT + JUDGED),
    "two_sample": (two_sample.judge, 60.0),
}
"""How each judges, and of how many seconds of each recording."""


@command("baseline", unused=UNUSED)
@threadpool_limits.wrap(limits=1, user_api="blas")  # its threads wait for each other busily where others work
def main(cfg: DictConfig) -> None:
    """Judge recordings as one baseline does; write ``diagnosis.json``."""
    folder, joint = Path(HydraConfig.get().runtime.output_dir), str(cfg.joint.name)
    if cfg.method not in METHODS:
        raise InputError(f"method = {cfg.method!r} is unknown; choose from {', '.join(METHODS)}")
    if joint not in ("B", "C"):
        raise InputError(f"joint={joint}: a baseline asks for the clearance of one joint; joint=B or joint=C")
    if not cfg.recordings:
        raise InputError("recordings = []: nothing to judge; give recordings=[a.parquet,b.parquet]")
    judge, seconds = METHODS[cfg.method]
    recordings = [corrected(read(path)) for path in cfg.recordings]
    bench = Bench.of(instantiate(cfg.mechanism, _convert_="all"), joint, recordings, seconds)
    found = judge(bench, load_effects("all", list(cfg.without)))
    write_json(folder / "diagnosis.json", found)
    names = " and ".join(effect["name"] for effect in found["effects"])
    log.info("verdict: %s %s; written to %s", found["verdict"], names, folder)


if __name__ == "__main__":
    main()
