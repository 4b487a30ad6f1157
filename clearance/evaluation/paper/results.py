"""A report (RESULTS.md), whole, from the files that trainings left: no number in it is typed by hand."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from matplotlib.figure import Figure

from clearance.evaluation import curves
from clearance.evaluation.paper.estimates import NAMES
from clearance.evaluation.paper.tables import comparisons, perturbed, table
from clearance.evaluation.paper.trainings import (
    Finished,
    Training,
    known_trainings,
    reductions,
    trainings_of,
)
from clearance.models.run_folder import hardware
from clearance.whole_files import write_atomically, write_json

_CURVES = "curves"
RECORD = "study.json"  # every training behind the tables, beside the pictures


class Drawing(Protocol):
    """A figure of the paper."""

    def draw(self, found: Mapping[Training, Finished]) -> Figure | None:
        """Draw it from finished trainings, or from none; ``None`` where they lack."""
        ...


TITLES = {
    "table5": "Table 5: trees at joint C",
    "table6": "Table 6: networks at joint C",
    "tdnn_variants": "Three aggregations of the TDNN (Section 5.1.2)",
    "table7": "Table 7: other contacts, and noise",
    "table8": "Table 8: networks at joint B",
    "table9": "Table 9: sets of sensors",
    "placement": "Sets of four by the information they hold (beyond the paper; docs/placement.md)",
    "decimation": "The decimation factor (Section 4.2; the paper gives no numbers)",
}
_COMPARED = (
    "table5",
    "table6",
    "tdnn_variants",
    "table8",
    "decimation",
)  # table 9 has 66 pairs
_PERTURBED = "table7"  # is about the trainings of table 6
_CAPTIONS = {
    "figure2": "Figure 2: acceleration of the slider by clearance in C, at the simulation's own rate.",
    "figure5": "Figure 5: sensor 10 before and after decimation.",
    "figure6": "Figure 6: bands that hold 99 % of the power above 50 Hz; their upper end over the clearance.",
    "figure7": "Figure 7: true and predicted clearance, trees, joint C; split 98, initialisation 42.",
    "figure8": "Figure 8: true and predicted clearance, networks, joint C; split 98, initialisation 42.",
    "figure9": "Figure 9: true and predicted clearance, networks, joint B; split 98, initialisation 42.",
}
_NOTES = """\
How to read the tables: mean ± standard deviation over trainings [95 % interval of the mean by Student's t,
as if trainings were independent]; in italics what the paper reports, on an NVIDIA A100. Errors are those of
single windows of 200 samples of the test recordings, in percent of 1 mm. "Paired t" is the paper's test,
over pairs of trainings of the same split and initialisation. Splits share recordings, so it finds
differences too easily; the corrected resampled t-test (Nadeau & Bengio 2003) takes one mean a split and
enlarges its variance by the ratio of test to training recordings. Holm's adjustment is over the rows of one
table. Where rows of a table are of different splits, they say of which: a split moves an error by more than
an initialisation does. Seconds are of the machine that each training had; of initialisations that were
trained together each has its share.
"""


def write_results(
    runs: Path,
    report: Path,
    pictures: Path,
    figures: Mapping[str, Drawing],
    beyond: Sequence[curves.Row] = (),
) -> None:
    """Write the report, its pictures and the numbers of every training behind it.

    Args:
        runs: folder of finished trainings of one scale.
        report: Markdown file.
        pictures: folder for pictures and ``study.json``, the record of every training: those of other
            machines, which only it knows, stay in the report.
        figures: by name; one that needs weights which are on another machine stays as it was drawn there.
        beyond: rows of trainings for the curves that the paper has not.

    Raises:
        InputError: two trainings differ in scale alone.
    """
    found = {one.training: one for one in known_trainings(runs, pictures / RECORD)}
    report.parent.mkdir(parents=True, exist_ok=True)
    pictures.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for name, drawing in figures.items():
        path, figure = pictures / f"{name}.png", drawing.draw(found)
        if figure is not None:
            write_atomically(path, figure.savefig)
        if path.exists():
            drawn[name] = path
    write_json(pictures / RECORD, [found[key].row for key in sorted(found)])
    text = results(found, {name: _link(path, report.parent) for name, path in drawn.items()})
    curve = curves.draw(beyond)
    if curve is not None:
        path = pictures / f"{_CURVES}.png"
        write_atomically(path, curve.savefig)
        title = "NMAE over the number of simulated runs and over the length of a window"
        picture = f"![{title}]({_link(path, report.parent)})"
        text = "\n".join(
            [
                text,
                "## Beyond the paper: more runs, longer windows\n",
                curves.markdown(beyond),
                f"{picture}\n",
            ]
        )
    write_atomically(report, lambda file: file.write_text(text, encoding="utf-8"))


def results(found: Mapping[Training, Finished], pictures: Mapping[str, str]) -> str:
    """The report.

    Args:
        found: finished trainings.
        pictures: links by name of the figure.
    """
    parts = [
        "# Results\n",
        "Made by `python -m clearance.evaluate report=FILE` (`make study` does it, too) from the files of "
        "finished trainings; do not edit.\n",
        _scale(list(found.values()), "Every table before the figures")
        if found
        else "No training is finished.\n",
        _NOTES,
    ]
    for experiment, title in TITLES.items():
        planned = trainings_of("table6" if experiment == _PERTURBED else experiment)
        own = [found[one] for one in planned if one in found]
        if experiment == _PERTURBED:
            own = [one for one in own if one.perturbed]
        content = perturbed(planned, found) if experiment == _PERTURBED else table(experiment, planned, found)
        parts.append(f"## {title}\n")
        if not content:
            parts.append("Not measured yet.\n")
            continue
        parts += [f"*{_short_scale(own)}*\n", content]
        tested = comparisons(experiment, planned, found) if experiment in _COMPARED else ""
        if tested:
            parts.append(tested)
    parts.append("## Figures\n")
    parts += [
        f"![{_CAPTIONS.get(name, name)}]({link})\n\n{_CAPTIONS.get(name, name)}\n"
        for name, link in pictures.items()
    ]
    return "\n".join(parts)


def _scale(runs: Sequence[Finished], what: str) -> str:
    """What was reduced, on what hardware, with which seeds, when."""
    different = reductions(runs)
    machines = sorted({_hardware(run) for run in runs})
    begin, end = (pick(run.date for run in runs) for pick in (min, max))
    scale = "smaller than the paper's" if different else "as in the paper"
    lines = [f"**Scale: {scale}.**"]
    if different:
        lines.append(f"{what} is of trainings that differ from the paper's in:\n")
        every = {run.training.setting.model for run in runs}
        for (key, own, paper), models in different.items():
            of = (
                "" if models == every else f"; {_listed(sorted(NAMES.get(model, model) for model in models))}"
            )
            lines.append(f"- `{key}`: {own} (paper: {paper}){of}")
    seeds = sorted({run.metrics["seed"] for run in runs})
    splits = sorted({run.metrics["split_seed"] for run in runs})
    return "\n".join(
        [
            *lines, "",
            f"{len(runs)} trainings, {begin} to {end}, on {'; '.join(machines)}. Seeds of the splits: "
            f"{_listed(splits)}; of the initial weights: {_listed(seeds)}; of the simulated recordings: "
            f"{_listed(sorted({run.data_seed for run in runs}))}.\n",
        ]
    )  # fmt: skip


def _short_scale(runs: Sequence[Finished]) -> str:
    recordings = _listed(sorted({run.metrics["data"]["recordings"] for run in runs}))
    scale = "Smaller than the paper's scale" if reductions(runs) else "Full scale"
    days = " to ".join(dict.fromkeys(pick(run.date for run in runs) for pick in (min, max)))
    seeds = sorted({run.metrics["split_seed"] for run in runs})
    splits = f"split{'s' if len(seeds) > 1 else ''} {_listed(seeds)}"
    machines = _listed(sorted({_hardware(run) for run in runs}))
    return f"{scale}: {recordings} recordings, {splits}; {machines}; {days}"


def _hardware(run: Finished) -> str:
    environment = run.metrics["environment"]
    return f"{hardware(environment)} (torch {environment['packages']['torch']})"


def _listed(values: Sequence[Any]) -> str:
    return ", ".join(map(str, values))


def _link(path: Path, start: Path) -> str:
    return Path(os.path.relpath(path, start)).as_posix()
