"""The paper's tables: what was measured, and under it what the paper reports."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

from clearance.evaluation.paper.estimates import NAMES
from clearance.evaluation.paper.statistics import (
    SIGNIFICANCE,
    Comparison,
    Summary,
    compare,
    holm,
    summarise,
)
from clearance.evaluation.paper.trainings import Finished, Setting, Training
from clearance.whole_files import read_yaml

_COLUMNS: dict[str, tuple[str, Callable[[Mapping[str, Any]], float]]] = {
    "nmae": ("NMAE [%]", lambda metrics: metrics["test"]["nmae"]),
    "nrmse": ("NRMSE [%]", lambda metrics: metrics["test"]["nrmse"]),
    "median_ae": ("median AE [µm]", lambda metrics: metrics["test"]["median_ae"] * 1e6),
    "p95_ae": ("95th percentile AE [µm]", lambda metrics: metrics["test"]["p95_ae"] * 1e6),
    "training": ("training [s]", lambda metrics: metrics["training_seconds"]),
    "evaluation": ("evaluation [s]", lambda metrics: metrics["evaluation_seconds"]),
}
_ERRORS = ("nmae", "nrmse", "median_ae", "p95_ae")
_SETS = {
    "rod": "4: rod", "all": "10: all", "no_slider": "8: no slider", "no_crank": "6: no crank",
    "no_rod": "6: no rod", "crank": "4: crank",
}  # fmt: skip
_SCENARIOS = {
    "base": "test recordings", "nominal": "new recordings", "restitution": "restitution +10/-20 %",
    "stiffness": "stiffness ±20 %", "hunt_crossley": "Hunt-Crossley", "all": "all three",
    "noise": "1 % noise",
}  # fmt: skip
Rows = list[tuple[str, ...]]


@cache
def paper_numbers() -> dict[str, Any]:
    """The paper's own, from the one file that holds them."""
    return read_yaml(Path(__file__).parent / "numbers.yaml") or {}


def table(experiment: str, planned: Sequence[Training], found: Mapping[Training, Finished]) -> str:
    """Errors and times by setting, measured and from the paper; empty where nothing is finished."""
    rows: Rows = []
    settings = dict.fromkeys(one.setting for one in planned)
    splits = {
        setting: sorted({one.split_seed for one in planned if one.setting == setting and one in found})
        for setting in settings
    }
    mixed = len({tuple(own) for own in splits.values() if own}) > 1
    for setting in settings:
        of_setting = [one for one in planned if one.setting == setting]
        runs = [found[one] for one in of_setting if one in found]
        if runs:
            columns = [
                _cell(summarise([value(run.metrics) for run in runs]), interval=key in _ERRORS)
                for key, (_, value) in _COLUMNS.items()
            ]
            own = splits[setting]
            which = f"; split{'s' if len(own) > 1 else ''} {', '.join(map(str, own))}" if mixed else ""
            count = f"{len(runs)} of {len(of_setting)}{which}"
            rows.append((row_name(experiment, setting), count, *columns))
            rows += _paper_row(experiment, setting)
    heads = ("", "trainings", *(head for head, _ in _COLUMNS.values()))
    return markdown(heads, rows) if rows else ""


def row_name(experiment: str, setting: Setting) -> str:
    """What tells a row of this table from its others."""
    name = NAMES.get(setting.model, setting.model)
    if experiment in ("table9", "placement"):
        return f"{_SETS.get(setting.sensors) or f'4: {setting.sensors}'}, {name}"
    if experiment == "decimation":
        return "every sample" if setting.decimation == 1 else f"every {setting.decimation}th sample"
    return name


def _paper_row(experiment: str, setting: Setting) -> Rows:
    own = paper_numbers().get(experiment, {})
    if experiment == "table9":
        own = own.get(setting.sensors, {})
    if setting.model not in own:
        return []
    numbers = own[setting.model]
    return [("*paper*", "", *(_paper_cell(numbers.get(key)) for key in _COLUMNS))]


def comparisons(experiment: str, planned: Sequence[Training], found: Mapping[Training, Finished]) -> str:
    """Every pair of rows by split and initialisation; empty where no pair was tested."""
    tested = [one for one in planned if one in found]
    settings = list(dict.fromkeys(one.setting for one in tested))
    pairs: list[tuple[str, str, Comparison]] = []
    for one, other in combinations(settings, 2):
        for key in ("nmae", "nrmse"):
            head, value = _COLUMNS[key]
            values = [
                {(t.split_seed, t.seed): value(found[t].metrics) for t in tested if t.setting == setting}
                for setting in (one, other)
            ]
            compared = compare(values[0], values[1], found[tested[0]].test_to_training)
            if compared:
                names = (row_name(experiment, setting) for setting in (one, other))
                pairs.append((" - ".join(names), head, compared))
    if not pairs:
        return ""
    p_values = [c.corrected_p for _, _, c in pairs if c.corrected_p is not None]
    adjusted = iter(holm(p_values))
    rows: Rows = []
    for name, head, c in pairs:
        corrected = next(adjusted) if c.corrected_p is not None else None
        interval = f" [{c.low:.2f}, {c.high:.2f}]" if c.low is not None and c.high is not None else ""
        significant = "cannot say" if corrected is None else "yes" if corrected < SIGNIFICANCE else "no"
        rows.append(
            (name, head, f"{c.pairs} in {c.splits}", f"{c.difference:+.2f}{interval}", _p(c.paired_p),
             _p(c.corrected_p), _p(corrected), significant)
        )  # fmt: skip
    heads = (
        "difference", "of", "pairs in splits", "mean [95 %, corrected]", "paired t, p",
        "corrected resampled t, p", "the same after Holm", f"below {SIGNIFICANCE:g}",
    )  # fmt: skip
    return markdown(heads, rows)


def perturbed(planned: Sequence[Training], found: Mapping[Training, Finished]) -> str:
    """Table 7: errors by perturbation, of the trainings for which they were measured."""
    rows: Rows = []
    for setting in dict.fromkeys(one.setting for one in planned):
        runs = [found[t] for t in planned if t.setting == setting and t in found]
        runs = [run for run in runs if run.perturbed]
        contents = [run.perturbed for run in runs if run.perturbed]
        if not runs:
            continue
        rows_of: dict[str, list[Mapping[str, float]]] = {"base": [run.metrics["test"] for run in runs]}
        for name in dict.fromkeys(name for content in contents for name in content):
            rows_of[name] = [content[name] for content in contents if name in content]
        for name, errors in rows_of.items():
            cells = [_cell(summarise([_error(one, key) for one in errors])) for key in _ERRORS]
            label = f"{NAMES.get(setting.model, setting.model)}, {_SCENARIOS.get(name, name)}"
            rows.append((label, str(len(errors)), *cells))
            numbers = paper_numbers()["table7"].get(setting.model, {}).get(name)
            if numbers:
                rows.append(("*paper*", "", *(_paper_cell(numbers.get(key)) for key in _ERRORS)))
    heads = ("", "trainings", *(_COLUMNS[key][0] for key in _ERRORS))
    return markdown(heads, rows) if rows else ""


def _error(metrics: Mapping[str, float], key: str) -> float:
    return metrics[key] * (1e6 if key in ("median_ae", "p95_ae") else 1.0)


def markdown(heads: Sequence[str], rows: Rows) -> str:
    """A Markdown table."""
    return "".join(f"| {' | '.join(row)} |\n" for row in [tuple(heads), ("---",) * len(heads), *rows])


def _cell(summary: Summary, interval: bool = True) -> str:
    digits = 2 if summary.mean < 100 else 0
    if summary.deviation is None:
        return f"{summary.mean:.{digits}f}"
    text = f"{summary.mean:.{digits}f} ± {summary.deviation:.{digits}f}"
    return f"{text} [{summary.low:.{digits}f}, {summary.high:.{digits}f}]" if interval else text


def _paper_cell(number: float | Sequence[float] | None) -> str:
    if number is None:
        return ""
    return f"*{number:g}*" if isinstance(number, int | float) else f"*{number[0]:g} ± {number[1]:g}*"


def _p(value: float | None) -> str:
    if value is None:
        return "too few"
    return "< 0.001" if value < 1e-3 else f"{value:.3f}"
