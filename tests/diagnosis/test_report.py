"""The page of a diagnosis in a real browser: offline, silent, narrow, true to its numbers, deaf to names."""

import base64
import hashlib
import json
import math
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from clearance.diagnosis.report import render_report, write_report
from clearance.errors import InputError
from tests.diagnosis.browser import Browser, find_browser
from tests.diagnosis.report_examples import EXAMPLES

HOSTILE = "</script><img src=x onerror=alert(1)>"
PHONE = {"width": 360, "height": 740, "touch": True}


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    program = find_browser()
    if program is None:
        pytest.skip("no browser of the Chromium family is installed")
    found = Browser(program, tmp_path_factory.mktemp("profile"))
    yield found
    found.close()


@pytest.fixture
def show(browser, tmp_path):
    """Write a report, open it, and insist that it draws itself without a complaint or a request."""

    def opened(diagnosis, evidence, **window):
        page = tmp_path / "report.html"
        write_report(page, diagnosis, evidence)
        browser.open(page, **window)
        assert browser.complaints == []
        assert [url for url in browser.requests if not url.startswith("data:")] == [page.as_uri()]
        if window.get("script", True):
            drawn = browser.run(
                "[{...document.documentElement.dataset}, document.documentElement.scrollWidth]"
            )
            assert drawn[0] == {"drawn": ""}
            assert drawn[1] <= window.get("width", 1280)
        return browser

    return opened


# ---- drawing


@pytest.mark.parametrize(
    ("name", "window"),
    [*((name, window) for name in EXAMPLES for window in ({}, PHONE)), ("physics", {"dark": True})],
)
def test_it_draws_itself_offline_without_complaint_and_fits_the_window(show, name, window):
    page = show(*EXAMPLES[name](), **window)
    headline = EXAMPLES[name]()[0]["summary"][0]
    assert page.run("document.querySelector('h1').innerText") == headline
    # Everything reaches at most to the edge, unless it scrolls inside a region of its own.
    edges = "[one.getBoundingClientRect().right, !one.closest('.scroll, pre, .tip, [hidden]'), one.outerHTML]"
    width = window.get("width", 1280)
    assert [html for right, bound, html in page.every("main *", edges) if bound and right > width + 1] == []
    assert page.run("getComputedStyle(document.body).backgroundColor") == (
        "rgb(20, 22, 26)" if window.get("dark") else "rgb(255, 255, 255)"
    )


EXPECTED = {
    "physics": ["where", "what", "better", "else", "seen", "checks", "numbers"],
    "none": ["where", "better", "seen", "checks", "numbers"],
    "unknown": ["where", "what", "better", "else", "curve", "numbers"],
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_parts_come_in_order_and_every_picture_has_words(show, name):
    page = show(*EXAMPLES[name]())
    assert page.every("section.block", "one.id") == EXPECTED[name]
    assert page.every("#contents a", "one.hash.slice(1)") == EXPECTED[name]
    pictures = page.every(
        "svg", "[one.getAttribute('aria-label') ?? one.getAttribute('aria-hidden'), one.outerHTML]"
    )
    assert all(words for words, _ in pictures)
    assert sum(words != "true" for words, _ in pictures) >= 5
    assert not [drawn for _, drawn in pictures if re.search("NaN|undefined|Infinity", drawn)]


def _reduced():
    """Diagnoses with less and less in them."""
    yield "nothing", ({}, {})
    yield "verdict", ({"verdict": "none"}, {})
    full = EXAMPLES["physics"]()
    yield "all null", ({key: None for key in full[0]}, {key: None for key in full[1]})
    yield "no evidence", (full[0], {})
    yield "no diagnosis", ({}, full[1])
    for value in ("null", "empty"):
        empty = {dict: {}, list: [], str: "", float: None}
        both = [
            {key: empty.get(type(part)) if value == "empty" else None for key, part in half.items()}
            for half in full
        ]
        yield f"{value} but mismatch", ({**both[0], "mismatch": full[0]["mismatch"]}, both[1])
    yield (
        "shallow",
        (
            {**full[0], "fit": {"held_out": {}}, "clearance": {"high_m": 5e-5}, "effects": [{"name": "x"}]},
            {key: ({} if isinstance(value, dict) else [{}]) for key, value in full[1].items()},
        ),
    )


@pytest.mark.parametrize("case", [pytest.param(case, id=name) for name, case in _reduced()])
def test_missing_parts_leave_out_their_picture_and_nothing_else(show, case):
    page = show(*case, **PHONE)
    assert page.run("document.querySelectorAll('.machine svg').length") == 1
    assert "undefined" not in page.run("document.querySelector('main').innerText")


@pytest.mark.parametrize("verdict", ["none", "physics", "instrument", "mixed", "unknown", "ambiguous"])
def test_each_verdict_has_its_own_badge(verdict):
    badges = {render_report({"verdict": verdict}, {}).split('class="badge">')[1].split("<")[0]}
    badges.add(render_report({}, {}).split('class="badge">')[1].split("<")[0])
    assert len(badges) == 2
    assert "No verdict was reached" in badges


@pytest.mark.parametrize(
    ("body", "direction"),
    [
        ("crank", "torque"),
        ("rod", "axial"),
        ("rod", "moment"),
        ("slider", "y"),
        ("frame", "x"),
        ("joint_b", ""),
        ("joint_c", "radial"),
        ("instrument", "slider_horizontal"),
    ],
)
def test_the_body_and_the_direction_are_marked_in_the_drawing(show, body, direction):
    diagnosis, _ = EXAMPLES["physics"]()
    diagnosis["mismatch"].update(body=body, direction=direction)
    page = show(diagnosis, {})
    if body == "instrument":
        assert page.run("document.querySelectorAll('.machine .fault').length") == 2  # of rod C and slider
        return
    marked = page.run("document.querySelectorAll('.machine g.culprit').length")
    assert (marked, page.run("document.querySelectorAll('.machine .arrow').length")) == (1, 1)
    for angle in (0, 90, 200, 300):  # the label stays in the picture while the machine turns
        page.put(".turning input", angle)
        edges = "(({left, top, right, bottom}) => [left, top, right, bottom])(one.getBoundingClientRect())"
        label, picture = page.every(".culprit-label", edges)[0], page.every(".machine", edges)[0]
        assert label[0] >= picture[0]
        assert label[1] >= picture[1] - 3  # a text's box is a little taller than its letters
        assert label[2] <= picture[2]
        assert label[3] <= picture[3] + 3


# ---- numbers


SHOWN = "{...one.dataset, shown: one.textContent}"


def _numbers(page):
    """What the page shows with a key, and the value it says it got from the embedded data."""
    found = page.every("[data-key]", SHOWN)
    return [{**one, "value": float(one["value"]), "scale": float(one["scale"])} for one in found]


def _parsed(shown):
    """A number as the page writes it, and half a unit of its last place."""
    plain = shown.replace("\u202f", "").replace("−", "-")
    mantissa, _, power = plain.partition("×10")
    exponent = int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 0)
    places = len(mantissa.partition(".")[2])
    return float(mantissa) * 10.0**exponent, 0.5 * 10.0 ** (exponent - places)


def _look(content, path):
    for key in path.split("."):
        content = content[int(key)] if isinstance(content, list | np.ndarray) else content[key]
    return content


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_number_on_the_page_is_the_diagnosis_number_rounded(show, name):
    diagnosis, evidence = EXAMPLES[name]()
    numbers = _numbers(show(diagnosis, evidence))
    sources = {"diagnosis": diagnosis, "evidence": evidence}
    for number in numbers:
        truth = _look(sources[number["source"]], number["key"])
        assert number["value"] == pytest.approx(truth, rel=1e-7), number
        value, half = _parsed(number["shown"])
        assert abs(value - truth * number["scale"]) <= half * (1 + 1e-6), number
        assert abs(value - truth * number["scale"]) <= 0.05 * abs(truth * number["scale"]), number
    keys = {number["key"] for number in numbers}
    held_out = [f"fit.held_out.{key}" for key, value in diagnosis["fit"]["held_out"].items() if value]
    wanted = {"seconds", "mismatch.p_value", "clearance.before_m", "clearance.after_m", "clearance.low_m"}
    for position, effect in enumerate(diagnosis["effects"]):
        wanted.add(f"effects.{position}.probability")
        for parameter in effect["parameters"]:
            wanted |= {f"effects.{position}.parameters.{parameter}.{key}" for key in ("value", "low", "high")}
    assert wanted | set(held_out[:3]) <= keys


def test_numbers_of_any_size_are_written_without_losing_them(show):
    values = (0.0, 1e-9, 3.2e-4, 0.0999999, 1.0, 9.995, 41.25, 99999.0, 1.5e11, -2.5e-6, -17.25)
    alone = {f"n{i}": {"value": value, "unit": "N"} for i, value in enumerate(values)}
    bounded = {
        name: {**one, "low": one["value"] - spread * 0.4, "high": one["value"] + spread}
        for name, one in alone.items()
        for spread in [0.025 * abs(one["value"])]
    }
    effects = [{"name": "alone", "parameters": alone}, {"name": "bounded", "parameters": bounded}]
    numbers = _numbers(show({"effects": effects}, {}))
    assert len(numbers) == 4 * len(values)
    for number in numbers:
        shown, half = _parsed(number["shown"])
        assert abs(shown - number["value"]) <= half * (1 + 1e-6)
        assert abs(shown - number["value"]) <= 0.006 * abs(number["value"])


def test_bars_are_as_long_as_their_numbers(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    page = show(diagnosis, evidence)
    lengths = dict(page.every("[data-bar]", "[one.dataset.bar, Number(one.getAttribute('width'))]"))
    held = diagnosis["fit"]["held_out"]
    for key in ("after", "floor"):
        ratio = lengths[f"fit.held_out.{key}"] / lengths["fit.held_out.before"]
        assert ratio == pytest.approx(held[key] / held["before"], rel=1e-6)
    impacts = evidence["impacts"]
    ratio = lengths["impacts.after.per_revolution"] / lengths["impacts.before.per_revolution"]
    assert ratio == pytest.approx(
        impacts["after"]["per_revolution"] / impacts["before"]["per_revolution"], rel=1e-6
    )


def test_heat_map_colours_follow_the_ratios(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    page = show(diagnosis, evidence)
    heat = evidence["where"]["heat"]
    cells = page.every(".heat rect.cell", "Number(one.classList[1].slice(1))")
    levels = np.array(cells[: heat.size]).reshape(heat.shape)
    order = np.argsort(heat, axis=None)
    assert np.all(np.diff(levels.ravel()[order]) >= 0)
    assert (levels.min(), levels.max()) == (0, 8)
    assert np.all(levels[heat < 1.1] == 0)


# ---- looking closer


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


@pytest.mark.parametrize("view", [1, 2])
def test_phase_average_and_spectrum_are_shown_too(show, view):
    page = show(*EXAMPLES["physics"](), **PHONE)
    page.run(f"document.querySelectorAll('#better .segments input')[{view}].click()")
    page.put("#better select", 2, "change")
    paths = page.every("#better .zoomable path.line", "one.getAttribute('d').length")
    assert len(paths) == (5 if view == 1 else 3)
    assert min(paths) > 100
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


# ---- safety and plain words


NAMED = ("slider_", "rod_", "crank_b", "_force", "_damping", "_ratio")  # keys that come from the user's side


def _poisoned(content):
    """The same data with every text and every name of a channel or parameter carrying markup."""
    known = {*EXAMPLES, "slider", "x", "sliding", "C"}  # words that the page must recognise
    if isinstance(content, dict):
        found = {}
        for key, value in content.items():
            foreign = any(part in key for part in NAMED) and key != "missing_force"
            found[f"{key}{HOSTILE}" if foreign else key] = _poisoned(value)
        return found
    if isinstance(content, list):
        return [_poisoned(value) for value in content]
    return f"{content}{HOSTILE}" if isinstance(content, str) and content not in known else content


@pytest.mark.parametrize("name", ["physics", "unknown"])
def test_names_that_look_like_markup_are_text(show, name):
    diagnosis, evidence = map(_poisoned, EXAMPLES[name]())
    page = show(diagnosis, evidence, **PHONE)
    assert page.run("document.querySelectorAll('img, iframe, object, [onerror]').length") == 0
    assert page.run("document.querySelectorAll('script').length") == 3
    shown = page.run("document.body.innerText")
    assert f"run_0.parquet{HOSTILE}" in shown or f"rig.csv{HOSTILE}" in shown
    assert shown.count(HOSTILE) > 20


class _Scripts(HTMLParser):
    def __init__(self):
        super().__init__()
        self.scripts, self.open, self.policy = [], False, ""

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        if found.get("http-equiv") == "Content-Security-Policy":
            self.policy = found["content"]
        self.open = tag == "script"
        if self.open:
            self.scripts.append([found.get("id"), ""])
        assert not {"src", "style"} & set(found)
        assert found.get("href", "#").startswith(("#", "data:"))

    def handle_endtag(self, tag):
        self.open = self.open and tag != "script"

    def handle_data(self, data):
        if self.open:
            self.scripts[-1][1] += data


def test_the_policy_allows_our_script_alone_and_the_data_comes_back(tmp_path):
    diagnosis = {"verdict": "none", "summary": [HOSTILE, "a & b <!-- c \u2028"], "value": 0.1 + 0.2}
    parser = _Scripts()
    parser.feed(render_report(diagnosis, {"name": HOSTILE}))
    content = dict(parser.scripts)
    assert json.loads(content["diagnosis"]) == diagnosis
    assert json.loads(content["evidence"]) == {"name": HOSTILE}
    digest = base64.b64encode(hashlib.sha256(content[None].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in parser.policy
    assert "default-src 'none'" in parser.policy


def test_without_scripts_the_words_and_the_numbers_remain(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    page = show(diagnosis, evidence, script=False)
    assert page.complaints == []
    text = page.call("DOMSnapshot.captureSnapshot", {"computedStyles": []})["strings"]
    assert any("scripts are switched off" in piece for piece in text)
    assert all(any(sentence in piece for piece in text) for sentence in diagnosis["summary"])
    assert any(piece.strip() == json.dumps(diagnosis, indent=2, ensure_ascii=False) for piece in text)


def test_arrays_and_what_json_lacks_are_taken():
    evidence = {"a": np.array([[1.0, np.nan], [np.inf, 2.0]]), "b": np.float32(0.1), "c": np.bool_(True),
                "d": (np.int64(3), None, math.nan), "e": 1 / 3}  # fmt: skip
    parser = _Scripts()
    parser.feed(render_report({}, evidence))
    found = json.loads(dict(parser.scripts)["evidence"])
    assert found == {"a": [[1, None], [None, 2]], "b": 0.1, "c": True, "d": [3, None, None], "e": 0.33333333}


def test_a_report_replaces_the_old_one_at_once_or_says_why_not(tmp_path):
    path = tmp_path / "report.html"
    path.write_text("old")
    write_report(path, {"verdict": "none"}, {})
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert [found.name for found in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(InputError, match=r"report\.html: cannot be written"):
        write_report(tmp_path / "missing" / "report.html", {}, {})
