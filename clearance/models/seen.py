"""Which machines a training has seen: weights go on from there, but are not tested on those again."""

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from clearance.errors import InputError
from clearance.models.run_folder import CONFIG, METRICS
from clearance.models.trusted import instantiate_trusted
from clearance.recording.dataset import Dataset
from clearance.whole_files import read_json, read_yaml

log = logging.getLogger(__name__)
_MACHINES = ("mechanism", "seed", "clearance_range", "speed_range")
"""Of a campaign, what decides the machine of a run, however it is recorded.

Not its joint and what is drawn at random beside: some runs of a campaign that leaves these to chance are
those of one that does not.
"""


def require_apart(begin: Path, config: Mapping[str, Any]) -> None:
    """Refuse weights that do not fit a training, or that have seen what it would be tested on.

    Args:
        begin: folder of a finished training.
        config: of the training that would go on from its weights, without interpolations.

    Raises:
        InputError: nothing is finished there, or it reads other channels or estimates other clearances, or
            it, or what it went on from itself, has seen recordings that this training would be tested on.
    """
    if not (begin / METRICS).exists():
        raise InputError(f"begin={begin}: no finished training there; set begin to the folder of one")
    machines, division = _seen(config)
    for folder, earlier in _ancestry(begin):
        try:
            (channels, targets), (read, estimated) = (
                (one["sensors"]["channels"], one["targets"]) for one in (config, earlier)
            )
            before, divided = _seen(earlier)
        except (KeyError, TypeError, AttributeError):
            raise InputError(
                f"begin={begin}: {folder / CONFIG} does not say what it has seen; set begin to a training of "
                "this version"
            ) from None
        if (channels, targets) != (read, estimated):
            raise InputError(
                f"begin={begin}: {folder} reads {', '.join(read)} for {' and '.join(estimated)}, and this "
                f"training {', '.join(channels)} for {' and '.join(targets)}; set sensors and joint as there"
            )
        if machines == before:
            _require_divided_alike(begin, folder, division, divided)


def require_same_division(begin: Path, config: Mapping[str, Any], recordings: int, fingerprint: str) -> None:
    """Refuse weights whose training divided other recordings of the same machines, or the same otherwise.

    Which recordings a seed sets apart depends on how many there are: of a store that has grown since, or of
    runs of which others failed, some that were trained on would be tested on. Recordings that lie elsewhere
    now are known by their fingerprint.

    Args:
        begin: folder of a finished training.
        config: of the training that would go on from its weights, without interpolations.
        recordings: that it divides.
        fingerprint: of these.

    Raises:
        InputError: it, or what it went on from itself, divided others, or these otherwise.
    """
    machines, division = _seen(config)
    if "streamed" in machines:
        return
    for folder, earlier in _ancestry(begin):
        if not (folder / METRICS).exists():
            continue
        known = read_json(folder / METRICS, "begin")["data"]
        before, divided = _seen(earlier)
        if known["fingerprint"] == fingerprint:  # as many, whatever was asked for
            _require_divided_alike(begin, folder, division, divided | {"runs": division["runs"]})
        if before != machines:
            continue
        from_files = machines["path"] is not None
        if known["fingerprint"] != fingerprint if from_files else known["recordings"] != recordings:
            raise InputError(
                f"begin={begin}: {folder} divided {known['recordings']} recordings of these machines, and "
                f"there are {recordings} now, or others: it has seen some that this training would be tested "
                "on; set another data_seed, or other data"
            )


def _require_divided_alike(
    begin: Path, folder: Path, division: Mapping[str, Any], divided: Mapping[str, Any]
) -> None:
    """Refuse the weights in ``folder`` if the same recordings were divided otherwise there."""
    other = [key for key, value in division.items() if value != divided.get(key)]
    if other:
        raise InputError(
            f"begin={begin}: {folder} has seen recordings that this training would be tested on "
            f"({' and '.join(other)} differ); set another data_seed, or these as there"
        )


def _ancestry(begin: Path) -> Iterator[tuple[Path, dict[str, Any]]]:
    """The configurations of a training, of the one whose weights it went on from, and so on."""
    known: list[Path] = []
    following: Path | None = begin
    while following is not None and following not in known:
        known.append(following)
        config: dict[str, Any] | None = (
            read_yaml(following / CONFIG, "begin") if (following / CONFIG).exists() else None
        )
        if config is None:
            log.warning("%s is gone, so that nobody knows which recordings its weights have seen", following)
            return
        yield following, config
        following = Path(config["begin"]) if config.get("begin") else None


def _seen(config: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Which machines a training sees, and what decides which of them it is tested on."""
    source, split = config["data"]["source"], config["data"].get("split", {})
    described, runs = _described(source)
    machines = {key: described.get(key) for key in (*_MACHINES, "path")}
    if "held_out" in source:  # epochs of their own, whatever the split
        return machines | {"streamed": True}, {"data.source.held_out": source["held_out"]}
    return machines, {
        "runs": runs,
        "split_seed": split.get("seed"),
        "data.split.train": split.get("train"),
        "data.split.validation": split.get("validation"),
    }


def _described(source: Mapping[str, Any]) -> tuple[dict[str, Any], int | None]:
    """What made a source's machines, and how many they are; of files from elsewhere, where they are."""
    if "simulation" in source:
        campaign = instantiate_trusted(source["simulation"], CONFIG)
        return campaign.settings, campaign.runs
    path = Path(str(source["path"])).resolve()
    if str(source["_target_"]).endswith("StoredSource"):
        try:
            dataset = Dataset.open(path)
        except InputError:  # a training needs it no more
            log.warning("%s is gone, so that nobody knows which machines it held", path)
            return {"path": str(path)}, source["runs"]
        return dataset.settings, source["runs"] or dataset.runs
    return {"path": str(path)}, None
