"""Looking closer: heat map, curves and the drawing by keyboard and mouse."""

import json
import re

import numpy as np
import pytest

from clearance.diagnosis.report import write_report
from tests.diagnosis.report.examples import EXAMPLES

PHONE = {"width": 390, "height": 800, "touch": True}


def _centre(page, selector, across=0.5, down=0.5):
    found = page.run(
        f"(() => {{ const one = document.querySelector({json.dumps(selector)});"
        "one.scrollIntoView({block: 'center', behavior: 'instant'}); const box = one.getBoundingClientRect();"
        "return [box.left, box.top, box.width, box.height] })()"
    )
    return found[0] + across * found[2], found[1] + down * found[3]


def test_the_heat_map_reads_by_keyboard_and_switches_to_after(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    page = show(diagnosis, evidence)
    page.run("document.querySelector('.heat').focus()")
    page.press("ArrowRight")  # lands on the largest
    where = evidence["where"]
    row, column = np.unravel_index(np.argmax(where["heat"]), where["heat"].shape)
    told = page.run("document.querySelector('.heat .tip').innerText")
    assert where["channels"][row].replace("_", " ") in told
    found = [float(value) for value in re.findall(r": ([\d.]+) × noise", told)]
    assert found == pytest.approx([where["heat"][row, column], where["heat_after"][row, column]], rel=5e-3)
    assert (
        page.run("document.querySelector('.turning output').innerText")
        == f"{where['crank_angle_deg'][column]:.0f}°"
    )
    count = "document.querySelectorAll('.heat .h8').length"
    assert page.run(count) > 0
    page.run("document.querySelectorAll('.card .segments input')[1].click()")
    assert page.run("document.querySelectorAll('.heat .h8:not(.stale)').length") == 0


def test_a_curve_zooms_by_dragging_reads_by_key_and_hides_a_series(show):
    page = show(*EXAMPLES["physics"]())
    chart = "#better .zoomable"
    page.run(
        "document.querySelectorAll('#better .comparison .segments input')[2].click()"
    )  # the course in time
    axis = f"{chart} svg > text.tick[text-anchor=middle]"
    before = page.every(axis, "Number(one.textContent)")
    x, y = _centre(page, chart, 0.3, 0.4)
    page.mouse("mouseMoved", x, y)
    page.mouse("mousePressed", x, y, "left")
    page.mouse("mouseMoved", x + 150, y, "left")
    page.mouse("mouseReleased", x + 150, y, "left")
    after = page.every(axis, "Number(one.textContent)")
    assert after[-1] - after[0] < 0.4 * (before[-1] - before[0])
    page.run(f"document.querySelector('{chart}').focus()")
    page.press("ArrowRight")
    told = page.run(f"document.querySelector('{chart} .tip').innerText")
    assert all(name in told for name in ("recorded:", "model before:", "model corrected:", "m/s²"))
    page.press("0")
    assert page.every(axis, "Number(one.textContent)") == before
    lines = f"document.querySelectorAll('{chart} path.line.before').length"
    assert page.run(lines) == 2  # the curve, and its difference from the recording
    page.run("document.querySelector('#better .key.before').click()")
    assert page.run(lines) == 0
    assert page.run("document.querySelector('#better .key.before').getAttribute('aria-pressed')") == "false"


@pytest.mark.parametrize(("view", "lines"), [(0, 5), (1, 3), (2, 5)])
def test_phase_average_spectrum_and_course_are_shown(show, view, lines):
    page = show(*EXAMPLES["physics"](), **PHONE)
    page.run(f"document.querySelectorAll('#better .comparison .segments input')[{view}].click()")
    page.put("#better .comparison select", 2, "change")
    paths = page.every("#better .zoomable path.line", "one.getAttribute('d').length")
    assert len(paths) == lines
    assert min(paths) > 100
    assert len(page.every("#better .zoomable path.band", "1")) == (view == 0)
    assert page.run("document.documentElement.dataset.error") is None


def test_the_drawing_turns_and_shows_where_the_mismatch_is(show):
    page = show(*EXAMPLES["physics"]())
    for angle, marked in ((90, 0), (185, 1), (10, 1)):  # 345-375 degrees goes over the top
        page.put(".turning input", angle)
        assert len(page.every(".machine svg.showing", "1")) == marked


def test_a_picture_that_breaks_is_named_and_leaves_the_others(browser, tmp_path):
    diagnosis, evidence = EXAMPLES["physics"]()
    evidence["ranking"] = [7, None, "x"]
    write_report(tmp_path / "report.html", diagnosis, evidence)
    browser.open(tmp_path / "report.html")
    assert browser.run("document.documentElement.dataset.error").startswith("what: ")
    assert "could not be drawn" in browser.run("document.body.innerText")
    assert browser.run("document.querySelectorAll('#better svg').length") > 3
