"""All rows added up: rates with exact intervals, errors, a confusion matrix; and the table of them."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import binomtest

from clearance.trial.case import SEVERAL, UNNAMED
from clearance.trial.shortfalls import AT_FLOOR, LIKE, shortfalls

Row = Mapping[str, Any]
BINS = (0.0, 0.5, 1.0, 2.0, 5.0, 20.0, float("inf"))
"""Of the visibility, in a power curve: 1 is the detection threshold."""
_NAMED = ("effect", "instrument", "beam", *SEVERAL)


def rate(hits: Sequence[bool]) -> dict[str, Any]:
    """Share of hits with its exact 95 % interval (Clopper & Pearson 1934); ``None`` of none."""
    count, total = int(sum(hits)), len(hits)
    if total == 0:
        return {"count": 0, "of": 0, "rate": None, "low": None, "high": None}
    interval = binomtest(count, total).proportion_ci(0.95, method="exact")
    return {"count": count, "of": total, "rate": count / total, "low": interval.low, "high": interval.high}


def quantiles(values: Sequence[float]) -> dict[str, Any]:
    """Number, median, 90 % quantile and largest of some values."""
    if not values:
        return {"of": 0, "median": None, "p90": None, "largest": None}
    return {
        "of": len(values), "median": float(np.median(values)), "p90": float(np.quantile(values, 0.9)),
        "largest": float(max(values)),
    }  # fmt: skip


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """The score of a trial: plain data.

    Rates of naming, places, unknown forces and their curves are over cases in which everything missing is at
    or above its detection threshold; a case without a verdict counts as wrong in all of them.
    """
    null = [row for row in rows if row["kind"] == "none"]
    seen = [row for row in rows if row["kind"] != "none" and row["visible"]]
    named = [row for row in seen if row["kind"] in _NAMED]
    single = [row for row in named if row["kind"] not in SEVERAL]
    unnamed = [row for row in seen if row["kind"] in UNNAMED]
    said = [row for row in rows if row["verdict"] is not None]
    held = [row["held_out"] for row in said if row["held_out"].get("after") is not None]
    # a beam has no single mode: the one that comes nearest to it has no true value
    asserted = [parameter for row in said if row["kind"] != "beam" for parameter in row["parameters"]]
    clearances = [row["clearance"] for row in said if row["clearance"] and row["right"]]
    curves = [row for row in unnamed if row["curve_correlation"] is not None]
    every = [row for row in rows if row["kind"] in _NAMED]
    # a machine that cannot run has left all unexplained; one with a force of free form is not asked
    claims = [row for row in said if row["verdict"] != "unknown" and _claims(row)]
    return {
        "cases": len(rows),
        "kinds": dict(Counter(row["kind"] for row in rows)),
        "without_verdict": sum(row["verdict"] is None for row in rows),
        "asked_again": sum(row.get("tries", 1) > 1 for row in rows),
        "below_threshold": sum(row["kind"] != "none" and not row["visible"] for row in rows),
        "false_alarms": rate([row["verdict"] != "none" for row in null]),
        "false_alarms_at_1_percent": rate([row["verdict"] != "none" for row in null if row["noise"] <= 0.01]),
        "null_scores": sorted(row["score"] for row in null if row.get("score") is not None),
        "detected": rate([_true(row, "detected") for row in seen]),
        "named_or_equivalent": rate([_true(row, "named_or_equivalent") for row in single]),
        "first_and_alone": rate([_true(row, "first_and_alone") for row in single]),
        "named_of_all": rate(
            [_true(row, "named_or_equivalent") for row in every if row["kind"] not in SEVERAL]
        ),
        "spurious": rate([row["spurious"] for row in said]),
        **{
            f"{kind}s_named_{among}": rate(
                [_true(row, "named_or_equivalent") for row in some if row["kind"] == kind]
            )
            for kind in SEVERAL
            for among, some in (("or_equivalent", named), ("of_all", every))
        },
        "several_named": rate(
            [
                one in row.get("rightly", ())
                for row in named if row["kind"] in SEVERAL for one in row["missing"]
            ]
        ),
        "fault_channel": rate([row["channel_right"] for row in said if row["channel_right"] is not None]),
        "body": rate([_true(row, "body_right") for row in seen]),
        "direction": rate([_true(row, "direction_right") for row in seen]),
        "unknown_with_body": rate([row["right"] for row in unnamed]),
        "curve_correlation": quantiles([row["curve_correlation"] for row in curves]),
        "curve_good": rate([row["curve_correlation"] >= LIKE for row in curves]),
        "curve_error": quantiles([row["curve_error"] for row in curves]),
        "parameter_coverage": rate([parameter["covered"] for parameter in asserted]),
        "parameter_error": quantiles([p["error"] for p in asserted if p["error"] is not None]),
        "clearance_coverage": rate([one["covered"] for one in clearances if one["covered"] is not None]),
        "clearance_coverage_of_all": rate(
            [bool(row["clearance"]["covered"]) for row in said
             if row["clearance"] and row["clearance"]["covered"] is not None]
        ),
        "clearance_error": quantiles([one["error"] for one in clearances]),
        "clearance_error_of_all": quantiles([row["clearance"]["error"] for row in said if row["clearance"]]),
        "clearance_error_at_best": quantiles(
            [row["clearance"]["error"] for row in said
             if row["right"] and row["clearance"] and row["sensors"] == "all" and row["noise"] <= 0.01]
        ),
        "clearance_error_before": quantiles(
            [abs(r["clearance"]["before"] / r["clearance_m"] - 1.0) for r in said
             if r["right"] and r["clearance"] and r["clearance"]["before"] is not None]
        ),
        "held_out_before": quantiles([one["before"] / one["floor"] for one in held if one.get("before")]),
        "held_out_after": quantiles([one["after"] / one["floor"] for one in held]),
        # every case counts, where the program knows such an error at all
        "held_out_at_floor": rate([_at_floor(row) for row in rows] if held else []),
        "claims_borne_out": rate(
            [row["left_over"] is not None and row["left_over"] <= 1.0 for row in claims]
        ),
        "left_over": quantiles([row["left_over"] for row in claims if row["left_over"] is not None]),
        "seconds": quantiles([row["seconds"] for row in rows]),
        "memory_mib": quantiles([row["memory_mib"] for row in rows if row.get("memory_mib")]),
        "power": _power(rows),
        "power_by_effect": {
            item: _power([row for row in rows if row["kind"] in _NAMED and row["item"] == item])
            for item in sorted({row["item"] for row in rows if row["kind"] in ("effect", "instrument")})
        },
        "confusion": _confusion(rows),
        "failures": [
            {key: row.get(key) for key in ("name", "kind", "item", "joint", "clearance_m", "sensors", "noise",
                                           "visibility", "verdict", "named")} | {"why": "; ".join(found)}
            for row in rows if (found := shortfalls(row))
        ],
    }  # fmt: skip


def _true(row: Row, key: str) -> bool:
    return bool(row.get(key))


def _claims(row: Row) -> bool:
    """Whether a verdict says that its machine is as good as a perfect one."""
    held = row.get("held_out") or {}
    return held.get("after") is not None and held["after"] <= AT_FLOOR * held["floor"]


def _at_floor(row: Row) -> bool:
    """Whether it says so of whole recordings: of one that is followed in part nobody knows the rest."""
    return _claims(row) and not row["held_out"].get("shares")


def _power(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Detection against visibility; of a pair, the plainer one's."""
    shown = [row for row in rows if row["visibility"]]
    plainest = np.array([max(row["visibility"].values()) for row in shown])
    found = []
    for low, high in pairwise(BINS):
        inside = [row for row, v in zip(shown, plainest, strict=True) if low <= v < high]
        found.append({"from": low, "to": high if np.isfinite(high) else None}
                     | {"detected": rate([_true(row, "detected") for row in inside]),
                        "right": rate([bool(row["right"]) for row in inside])})  # fmt: skip
    return found


def _confusion(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """What is true against what was said first; ``equivalent``: it is among those not told apart."""
    table: dict[str, dict[str, int]] = {}
    for row in rows:
        truth = row["item"] if row["kind"] in ("effect", "instrument", "none", *SEVERAL) else row["kind"]
        if row["verdict"] is None:
            said = "no verdict"
        elif not row["named"]:
            said = row["verdict"]
        elif row["kind"] in SEVERAL and set(row["missing"]) <= set(row["rightly"]):
            said = row["kind"]
        elif row["named_or_equivalent"] and not set(row["missing"]) <= set(row["rightly"]):
            said = "equivalent"
        else:
            said = row["named"][0]
        cells = table.setdefault(truth, {})
        cells[said] = cells.get(said, 0) + 1
    return {truth: dict(sorted(cells.items())) for truth, cells in sorted(table.items())}


def table(summary: Mapping[str, Any]) -> str:
    """The headline rows as a Markdown table, without those to which no case belongs."""
    lines = ["| | measured | 95 % interval | wanted |", "|---|---|---|---|"]
    for label, key, wanted, show in _ROWS:
        if summary[key]["of"] == 0:
            continue
        measured, interval = show(summary[key])
        lines.append(f"| {label} | {measured} | {interval} | {wanted} |")
    return "\n".join(lines) + "\n"


def comparison(summaries: Mapping[str, Mapping[str, Any]]) -> str:
    """What several programs made of the same cases, as a Markdown table: a column each.

    Args:
        summaries: name of the program to its summary.
    """
    lines = [f"| | {' | '.join(summaries)} |", f"|---|{'---|' * len(summaries)}"]
    for label, key, _, show in _ROWS:
        if key in _COMPARED:
            cells = [show(summary[key])[0] for summary in summaries.values()]
            lines.append(f"| {label} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def history(summaries: Mapping[str, Mapping[str, Any]]) -> str:
    """Published trials, the newest first, as a Markdown table: a row each.

    Args:
        summaries: file to what it holds, with the ``date`` when it was revealed.
    """
    newest = sorted(summaries.items(), key=lambda one: (one[1]["date"], one[0]), reverse=True)
    lines = [
        f"| revealed | seed | machines | no verdict | {' | '.join(label for label, _, _ in _HISTORY)} |",
        f"|---|---|---|---|{'---|' * len(_HISTORY)}",
    ]
    for name, one in newest:
        cells = [show(one[key]) for _, key, show in _HISTORY]
        first = f"{one['date']} | [{one['seed']}]({name}) | {one['cases']} | {one['without_verdict']}"
        lines.append(f"| {first} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def failures(summary: Mapping[str, Any]) -> str:
    """One line a failure, and how many were asked again after one."""
    again = summary.get("asked_again", 0)
    lines = [f"{again} asked again after a failure"] if again else []
    for one in summary["failures"]:
        strength = ", ".join(f"{name} {v:.1f}" for name, v in one["visibility"].items()) or "nothing missing"
        lines.append(
            f"{one['name']} ({one['kind']}: {strength}; {one['joint']}, {one['clearance_m'] * 1e3:.3f} mm, "
            f"{one['sensors']}, noise {one['noise']:.0%}): {one['why']}"
        )
    return "\n".join(lines)


def _rate_cells(one: Mapping[str, Any]) -> tuple[str, str]:
    if one["of"] == 0:
        return "none", ""
    return f"{one['count']} of {one['of']} ({one['rate']:.1%})", f"{one['low']:.1%} to {one['high']:.1%}"


def _error_cells(one: Mapping[str, Any]) -> tuple[str, str]:
    if one["of"] == 0:
        return "none", ""
    return f"median {_percent(one['median'])} %, 90 % below {_percent(one['p90'])} %", ""


def _percent(share: float) -> str:
    """Two figures, without an exponent."""
    return f"{100 * share:.2g}" if 100 * abs(share) < 99.5 else f"{100 * share:.0f}"


def _number_cells(one: Mapping[str, Any]) -> tuple[str, str]:
    if one["of"] == 0:
        return "none", ""
    median, most = (f"{x:.3g}" if abs(x) < 999.5 else f"{x:.0f}" for x in (one["median"], one["p90"]))
    return f"median {median}, 90 % below {most}", ""


_Show = Callable[[Mapping[str, Any]], tuple[str, str]]
_ROWS: tuple[tuple[str, str, str, _Show], ...] = (
    ("false alarms where nothing is missing", "false_alarms", "", _rate_cells),
    ("the same with 1 % noise", "false_alarms_at_1_percent", "at most 5 %", _rate_cells),
    ("detected, above the threshold", "detected", "", _rate_cells),
    ("one effect or fault named, or in the equivalent set", "named_or_equivalent", "95 %", _rate_cells),
    ("named first and alone", "first_and_alone", "85 %", _rate_cells),
    ("named or equivalent, those below the threshold included", "named_of_all", "", _rate_cells),
    ("pairs: both named, or in the equivalent set", "pairs_named_or_equivalent", "", _rate_cells),
    ("the same, those below the threshold included", "pairs_named_of_all", "", _rate_cells),
    ("triples: all three named, or in the equivalent set", "triples_named_or_equivalent", "", _rate_cells),
    ("the same, those below the threshold included", "triples_named_of_all", "", _rate_cells),
    ("single effects named, within pairs and triples", "several_named", "", _rate_cells),
    ("of faults that were named: in the right channel", "fault_channel", "", _rate_cells),
    ("body right", "body", "95 %", _rate_cells),
    ("body and direction right", "direction", "95 %", _rate_cells),
    ("something asserted that is not there, of all verdicts", "spurious", "", _rate_cells),
    ("outside the list: `unknown` with the right body", "unknown_with_body", "90 %", _rate_cells),
    ("free-form force correlates at least 0.95", "curve_good", "", _rate_cells),
    ("error of the free-form force", "curve_error", "", _error_cells),
    ("parameters inside their 95 % intervals", "parameter_coverage", "90 to 98 %", _rate_cells),
    ("clearance inside its 95 % interval, right verdicts", "clearance_coverage", "90 to 98 %", _rate_cells),
    ("the same, of all verdicts that give one", "clearance_coverage_of_all", "", _rate_cells),
    ("error of the parameters", "parameter_error", "", _error_cells),
    ("error of the clearance, before, right verdicts", "clearance_error_before", "", _error_cells),
    ("error of the clearance, after, right verdicts", "clearance_error", "", _error_cells),
    (
        "error of the clearance, after, right verdicts by all sensors at 1 % noise",
        "clearance_error_at_best",
        "at most 0.2 %",
        _error_cells,
    ),
    ("error of the clearance, after, all verdicts", "clearance_error_of_all", "", _error_cells),
    ("held-out error over its floor, before", "held_out_before", "", _number_cells),
    ("held-out error over its floor, after", "held_out_after", "at most 1.1", _number_cells),
    ("held-out error within 1.1 of its floor", "held_out_at_floor", "", _rate_cells),
    ("within 1.1 by its own account, confirmed on unseen motion", "claims_borne_out", "", _rate_cells),
    ("seconds a case", "seconds", "at most 300", _number_cells),
    ("largest memory of a case [MiB]", "memory_mib", "at most 2048", _number_cells),
)
_COMPARED = frozenset({
    "false_alarms", "detected", "named_or_equivalent", "first_and_alone", "pairs_named_or_equivalent", "body",
    "unknown_with_body", "parameter_coverage", "clearance_coverage", "clearance_error_of_all", "seconds",
})  # fmt: skip
"""Rows of the comparison."""


def _count(one: Mapping[str, Any]) -> str:
    return f"{one['count']} of {one['of']}"


_HISTORY: tuple[tuple[str, str, Callable[[Mapping[str, Any]], str]], ...] = (
    ("false alarms", "false_alarms", _count),
    ("named", "named_or_equivalent", _count),
    ("pairs", "pairs_named_or_equivalent", _count),
    ("right body", "body", _count),
    ("`unknown`, right body", "unknown_with_body", _count),
    ("curve 0.95", "curve_good", _count),
    ("parameters covered", "parameter_coverage", _count),
    ("held-out within 1.1", "held_out_at_floor", _count),
    (
        "clearance, best sensors, 90 % below",
        "clearance_error_at_best",
        lambda one: f"{_percent(one['p90'])} %" if one["of"] else "none",
    ),
    ("90 % of cases within", "seconds", lambda one: f"{one['p90']:.0f} s" if one["of"] else "none"),
)
