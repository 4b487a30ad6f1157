"""The measurements as a table on the screen and as a file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from clearance.whole_files import write_json


def lines(report: dict[str, Any]) -> Iterator[str]:
    """The table, line by line."""
    scale, hardware = report["scale"], report["hardware"]
    yield (
        f"{scale['runs']} runs of {scale['duration_s']:g} s at h = {scale['step_s']:g} s, {scale['workers']} "
        f"workers on {hardware['cpu']} with {hardware['cores']} cores, load {hardware['load_average'][0]:.1f}"
    )
    yield f"{'':44}{'wall s':>8}{'CPU s':>8}{'ns/step/core':>14}{'Msteps/s':>10}"
    for entry in report["campaign"]:
        yield (
            f"{entry['task']:44}{entry['wall_s']:8.2f}{entry['cpu_s']:8.2f}{entry['ns_per_step_per_core']:14.1f}"
            f"{entry['steps_per_second'] / 1e6:10.1f}{_remarks(entry, scale['full'])}"
        )
    for entry in report["startup"]:
        yield f"{entry['task']:44}{entry['wall_s']:8.2f}{entry['cpu_s']:8.2f}{_remarks(entry, True)}"
    if report["comparison"] is None:
        yield "not compared with Exudyn: pip install '.[exudyn]' adds that, comparison=null leaves it out"
        return
    yield f"{'one core, by processor time':50}{'steps/s':>20}{'ratio':>8}  slider acceleration, std [m/s^2]"
    for entry in report["comparison"]:
        deviations = entry["slider_acceleration_deviation"]
        spread = "; ".join(f"{_span(found)} at {float(c) * 1e3:g} mm" for c, found in deviations.items())
        yield f"{entry['code']:50}{entry['steps_per_second_per_core']:20,.0f}{entry['ratio']:8.1f}  {spread}"


def markdown(report: dict[str, Any]) -> str:
    """The main rows as a Markdown table, hardware and date first."""
    scale, hardware = report["scale"], report["hardware"]
    title = f"{scale['runs']} runs of {scale['duration_s']:g} s, h = {scale['step_s']:g} s"
    place = (
        f"{scale['workers']} threads on {hardware['cpu']}, {hardware['cores']} cores, {report['date'][:10]}"
    )
    rows = [f"| {title}; {place} | wall | processor | a step and core |", "|---|---|---|---|"]
    for entry in report["campaign"]:
        memory = f", peak {entry['peak_rss_mib']:.0f} MiB" if "peak_rss_mib" in entry else ""
        rows.append(
            f"| {entry['task']}{memory} | {entry['wall_s']:.1f} s | {entry['cpu_s']:.1f} s "
            f"| {entry['ns_per_step_per_core']:.0f} ns |"
        )
    rows += [
        f"| {e['task']}, warm cache | {e['wall_s']:.1f} s | {e['cpu_s']:.1f} s | |" for e in report["startup"]
    ]
    for entry in (report["comparison"] or [])[1:]:
        speed = 1e9 / entry["steps_per_second_per_core"]
        rows.append(f"| {entry['code']}: {entry['ratio']:.0f} times slower a core | | | {speed:,.0f} ns |")
    return "\n".join(rows) + "\n"


def _remarks(entry: dict[str, Any], full: bool) -> str:
    remarks = []
    if "written_mib" in entry:
        remarks.append(f"{entry['written_mib']:.0f} MiB written, peak memory {entry['peak_rss_mib']:.0f} MiB")
    if "target_s" in entry and full:
        met = entry["wall_s"] <= entry["target_s"]
        remarks.append(f"target {entry['target_s']:g} s {'met' if met else 'missed'}")
    if entry.get("failed"):
        remarks.append(f"{entry['failed']} runs failed")
    return f"  {'; '.join(remarks)}" if remarks else ""


def _span(values: list[float]) -> str:
    return f"{values[0]:.0f}" if len(values) == 1 else f"{min(values):.0f}-{max(values):.0f}"


def save(report: dict[str, Any], path: Path) -> None:
    """Write the file whole or not at all."""
    write_json(path, report)
