"""In which order the paper's trainings are worth their time, and what each will probably take."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import NamedTuple

from clearance.evaluation.paper.trainings import Setting, Training


class Batch(NamedTuple):
    """Trainings that differ in their initial weights alone: given to one process as one list."""

    setting: Setting
    split_seed: int
    seeds: tuple[int, ...]

    @property
    def trainings(self) -> list[Training]:
        """One a seed."""
        return [Training(self.setting, self.split_seed, seed) for seed in self.seeds]

    def __str__(self) -> str:
        model, sensors, joint, decimation = self.setting
        seeds = ", ".join(map(str, self.seeds))
        return f"{model}, {sensors}, joint {joint}, 1:{decimation}, split {self.split_seed}, seeds {seeds}"


class Cost(NamedTuple):
    """What a training took, everything included [s]."""

    model: str
    decimation: int
    seconds: float


def stages(experiments: Sequence[Sequence[Training]]) -> list[list[Batch]]:
    """Breadth first: every row once; then the other splits; then the other initialisations.

    Args:
        experiments: trainings of each table, tables and trainings in order of value.
    """
    done: set[Training] = set()
    found = []
    for whole_splits, whole_seeds in ((False, False), (True, False), (True, True)):
        batches: dict[tuple[Setting, int], list[int]] = {}
        for trainings in experiments:
            splits = list(dict.fromkeys(t.split_seed for t in trainings))[: None if whole_splits else 1]
            seeds = list(dict.fromkeys(t.seed for t in trainings))[: None if whole_seeds else 1]
            for one in trainings:
                if one.split_seed in splits and one.seed in seeds and one not in done:
                    done.add(one)
                    batches.setdefault((one.setting, one.split_seed), []).append(one.seed)
        found.append([Batch(*key, tuple(seeds)) for key, seeds in batches.items()])
    return found


def expected_seconds(setting: Setting, costs: Sequence[Cost]) -> float | None:
    """What a training of this setting will take, from those that were measured; ``None``: nobody knows.

    A model's cost is in proportion to its windows, and these to the samples that decimation leaves.
    """
    own = [cost for cost in costs if cost.model == setting.model]
    like = [cost.seconds for cost in own if cost.decimation == setting.decimation]
    if like:
        return median(like)
    return median([cost.seconds * cost.decimation / setting.decimation for cost in own]) if own else None


def that_fit(batch: Batch, expected: float | None, left: float, begun: Mapping[Training, bool]) -> Batch:
    """As many of a batch's trainings as end in ``left`` seconds.

    Of a model that was never timed, and of a training that was cut before, it is not known when it ends: one
    is let go on until the time is up.
    """
    if batch.seeds and (not expected or begun.get(batch.trainings[0], False)):
        return batch._replace(seeds=batch.seeds[:1])
    count = int(left / expected) if expected else 0
    return batch._replace(seeds=batch.seeds[:count])
