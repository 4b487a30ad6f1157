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
from tests.diagnosis.report.examples import EXAMPLES

HOSTILE = "</script><img src=x onerror=alert(1)>"
PHONE = {"width": 390, "height": 800, "touch": True}


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
    "instrument": ["where", "what", "better", "else", "seen", "checks", "numbers"],
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


def test_faults_that_cannot_be_told_apart_are_told_with_their_channels(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    diagnosis["equivalent"] = [["sensor_gain"], ["sensor_gain", "gravity"]]
    diagnosis["equivalent_channels"] = [["rod_b_axial"], ["rod_c_axial", None]]
    shown = show(diagnosis, evidence).every(".alternative", "one.innerText")
    assert shown == ["sensor gain of rod b axial", "sensor gain of rod c axial + gravity"]


@pytest.mark.parametrize("window", [{}, {"width": 900}, PHONE])
def test_key_figures_with_many_digits_lie_beside_or_below_one_another(show, window):
    diagnosis, evidence = EXAMPLES["physics"]()
    diagnosis["clearance"] |= {
        "before_m": 7.8578953e-05, "after_m": 7.5276625e-05, "low_m": 7.5247911e-05, "high_m": 7.5305339e-05,
    }  # fmt: skip
    page = show(diagnosis, evidence, **window)
    figures = page.every(".figure .value", "[one.clientWidth, one.scrollWidth, one.innerText]")
    assert any("0.075277" in text for *_, text in figures)
    assert all(inside <= width for width, inside, _ in figures), figures


def test_what_is_off_at_infinity_has_no_mark_at_zero(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    resonance = {"value": 2000.0, "low": 300.0, "high": 6000.0, "unit": "Hz", "off": None}
    diagnosis["effects"][0]["parameters"] = {"frequency": resonance}
    page = show(diagnosis, evidence)
    bar = "#what .effects svg[aria-label$='95 % interval 300 to 6000']"
    assert len(page.every(bar, "1")) == 1
    assert not page.every(f"{bar} .off", "1")


@pytest.mark.parametrize("kept", [True, False])
def test_a_file_of_what_sensors_do_is_told_of_where_it_was_written(show, kept):
    diagnosis, evidence = EXAMPLES["physics"]()
    diagnosis["sensors"] = {"rod_b_axial": {"gain": {"value": 1.01, "low": 1.0, "high": 1.02, "unit": ""}}}
    text = show(diagnosis, {**evidence, "sensors_file": kept}).run(
        "document.querySelector('#sensors').innerText"
    )
    assert ("sensors.yaml" in text) == kept


def test_a_band_ends_where_nothing_is_known(show):
    diagnosis, evidence = EXAMPLES["unknown"]()
    force = evidence["free_form"] = dict(diagnosis["free_form"])
    pieces = []
    for unknown in (None, len(force["table"]) // 2):
        for key, by in (("low", -1.0), ("high", 1.0)):
            force[key] = [None if i == unknown else value + by for i, (_, value) in enumerate(force["table"])]
        drawn = show(diagnosis, evidence).every("#curve path.band", "one.getAttribute('d')")
        pieces.append(sum(path.count("M") for path in drawn))
    assert pieces == [1, 2]


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


def test_each_verdict_has_its_own_badge():
    verdicts = ("none", "physics", "instrument", "mixed", "unknown", "ambiguous", None)
    pages = {verdict: render_report({"verdict": verdict}, {}) for verdict in verdicts}
    badges = {verdict: page.split('class="badge">')[1].split("<")[0] for verdict, page in pages.items()}
    assert len(set(badges.values())) == len(verdicts)
    assert badges["none"] == "Nothing is missing"
    assert "Physics is missing" in badges["physics"]
    assert badges[None] == "No verdict was reached"


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
    diagnosis["effects"] = []
    page = show(diagnosis, {})
    if body == "instrument":
        assert page.run("document.querySelectorAll('.machine .fault').length") == 2  # of rod C and slider
        assert page.run("document.querySelectorAll('.machine .arrow').length") == 0
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


# ---- safety and plain words


NAMED = ("slider_", "rod_", "crank_b", "_force", "_damping", "_ratio")  # keys that come from the user's side


def _poisoned(content):
    """The same data with every text and every name of a channel or parameter carrying markup."""
    known = {*EXAMPLES, "slider", "x", "sliding", "C"}  # words that the page must recognise
    if isinstance(content, dict):
        found = {}
        for key, value in content.items():
            foreign = any(part in key for part in NAMED) and key not in ("missing_force", "slider_position_m")
            found[f"{key}{HOSTILE}" if foreign else key] = _poisoned(value)
        return found
    if isinstance(content, list):
        return [_poisoned(value) for value in content]
    return f"{content}{HOSTILE}" if isinstance(content, str) and content not in known else content


def test_nothing_found_and_not_confirmed_is_not_called_missing(show):
    diagnosis, evidence = EXAMPLES["none"]()
    diagnosis["verdict"] = "unknown"
    diagnosis["mismatch"] |= {"detected": False, "body": None, "direction": None}
    page = show(diagnosis, evidence)
    assert page.run("document.querySelector('.badge').innerText").startswith(
        "Nothing was found, and nothing was confirmed"
    )
    facts = page.run("document.querySelector('.facts').innerText")
    assert "what was held out could not be followed" in facts


@pytest.mark.parametrize(
    ("basis", "told"), [("prediction", True), ("fitted recordings and motion", True), ("motion", False)]
)
def test_what_the_motion_alone_shows_is_not_said_to_explain(show, basis, told):
    diagnosis, evidence = EXAMPLES["physics"]()
    diagnosis["equivalent"], diagnosis["next_experiment"] = [], None
    for effect in diagnosis["effects"]:
        effect["basis"] = basis
    text = show(diagnosis, evidence).run("document.body.innerText")
    assert ("Nothing else that was tried explains these recordings as well" in text) == told
    assert ("What else it could be" in text) == told  # no heading without a word


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
    with pytest.raises(InputError, match=r"report\.html: not written"):
        write_report(tmp_path / "missing" / "report.html", {}, {})
