"""The evidence behind a verdict: force, curve, signatures, profile, what could be seen, a sensor at fault."""

import re

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.nominal_map import nominal_map
from clearance.diagnosis.report import render_report
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.report.examples import CHANNELS, EXAMPLES, _signature

PHONE = {"width": 390, "height": 800, "touch": True}


def choose(page, selector, index):
    page.put(selector, index, "change")


# ---- the missing force


def test_the_missing_force_is_drawn_over_time_with_its_band_and_against_where_the_machine_was(show):
    page = show(*EXAMPLES["physics"](), **PHONE)
    box = "#where .missing-force"
    assert page.run(f"document.querySelector('{box} h3').innerText").endswith("force on the slider along x")
    assert len(page.every(f"{box} path.band", "1")) == 1
    labels = page.every(f"{box} .segments label", "one.innerText")
    assert labels == ["time", "angle", "position", "velocity"]
    for index, axis in ((1, "crank angle [°]"), (2, "slider position [m]"), (3, "slider velocity [m/s]")):
        page.run(f"document.querySelectorAll('{box} .segments input')[{index}].click()")
        assert page.every(f"{box} .axis-label", "one.textContent")[-1] == axis
        assert len(page.every(f"{box} circle.dot", "1")) == 400
        assert len(page.every(f"{box} line.reach", "1")) == 400
    choose(page, f"{box} select", 1)
    assert page.run(f"document.querySelector('{box} h3').innerText").endswith("torque on the crank")
    assert page.run("document.documentElement.scrollWidth") <= 390


def test_friction_against_velocity_is_a_step_in_the_picture(show):
    page = show(*EXAMPLES["physics"]())
    page.run("document.querySelectorAll('.missing-force .segments input')[3].click()")
    dots = np.array(
        page.every(".missing-force circle.dot", "[one.getAttribute('cx'), one.getAttribute('cy')]"), float
    )
    left, right = (dots[dots[:, 0] < np.median(dots[:, 0])], dots[dots[:, 0] > np.median(dots[:, 0])])
    assert np.median(left[:, 1]) < np.median(right[:, 1]) - 50  # down the page is less force


def test_a_view_is_offered_only_where_its_array_is_given(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    first = {k: v for k, v in evidence["missing_force"][0].items() if not k.startswith("slider_")}
    page = show(diagnosis, {"missing_force": [first]})
    assert page.every(".missing-force .segments label", "one.innerText") == ["time", "angle"]
    assert page.every(".missing-force select", "1") == []
    page = show(diagnosis, {"missing_force": []})
    assert page.every(".missing-force", "1") == []


# ---- the curve


@pytest.mark.parametrize("banded", [True, False])
def test_the_curve_says_in_words_what_acts_where_against_what(show, banded):
    diagnosis, evidence = EXAMPLES["unknown"]()
    if not banded:
        del evidence["free_form"]  # the contract's table alone
    page = show(diagnosis, evidence, **PHONE)
    assert page.run("document.querySelector('#curve h3').innerText") == (
        "Force on the slider along x against slider position"
    )
    assert len(page.every("#curve path.band", "1")) == banded
    assert page.every("#curve .axis-label", "one.textContent") == ["force [N]", "slider position [m]"]
    table = diagnosis["free_form"]["table"]
    assert len(page.every("#curve tbody tr", "1")) == len(table)
    assert len(page.every("#curve tbody tr:first-child td", "1")) == (4 if banded else 2)


# ---- signatures


def test_a_band_a_distance_and_a_choice_of_channel_and_recording(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    page = show(diagnosis, evidence)
    runs = evidence["signatures"]["recordings"]
    for recording in (0, 1):
        page.run(
            "(() => { const one = document.querySelectorAll('.comparison select')[1];"
            f"one.value = {recording}; one.dispatchEvent(new Event('change')); }})()"
        )
        shown = page.every(
            ".comparison [data-key*='.distance.']", "[one.dataset.key, Number(one.dataset.value)]"
        )
        assert len(shown) == 2 * len(CHANNELS)
        for key, value in shown:
            _, _, run, _, channel, _, kind = key.split(".")
            assert int(run) == recording
            truth = runs[recording]["phase"][int(channel)]["distance"][kind]
            assert value == pytest.approx(truth, rel=1e-7)
    choose(page, ".impacts select", 1)
    found = dict(page.every(".impacts [data-key]", "[one.dataset.key, Number(one.dataset.value)]"))
    assert found["signatures.recordings.1.impacts.before.per_revolution"] == pytest.approx(9.1 * 1.3)


def test_every_chooser_is_reached_and_turned_by_keyboard(show):
    page = show(*EXAMPLES["physics"]())
    for selector, key in ((".comparison .segments input", "ArrowRight"), (".comparison select", "ArrowDown")):
        page.run(f"document.querySelector('{selector}').focus()")
        assert page.run(f"document.activeElement === document.querySelector('{selector}')")
        before = page.every(".comparison .axis-label", "one.textContent")
        page.press(key)
        page.run("new Promise((done) => setTimeout(done, 50))")
        assert page.every(".comparison .axis-label", "one.textContent") != before


def test_signatures_of_a_model_that_could_not_run_and_without_impacts(show):
    diagnosis, evidence = EXAMPLES["physics"]()
    run = evidence["signatures"]["recordings"][0]
    run["impacts"] = None
    for entry in run["phase"]:
        del entry["before"], entry["distance"]["before"]
        entry["after"]["spread"] = [None] * len(entry["after"]["spread"])
    page = show(diagnosis, {"signatures": {"recordings": [run]}})
    assert page.every(".impacts", "1") == []
    assert len(page.every(".comparison path.line", "1")) == 3


def test_four_recordings_of_ten_channels_make_a_page_of_a_megabyte_and_a_half_at_most():
    rng = np.random.default_rng(0)
    diagnosis, evidence = EXAMPLES["physics"]()
    runs = [_signature(rng, f"run_{k}", 1.0) for k in range(4)]
    for run in runs:
        for part in ("phase", "spectrum"):
            run[part] += run[part][:2]
            for entry in run[part]:
                for kind in ("recorded", "before", "after"):
                    values = entry[kind]
                    entry[kind] = (
                        {key: np.round(one, 1) for key, one in values.items()}
                        if part == "phase"
                        else np.round(values, 2)
                    )
    evidence["signatures"]["recordings"] = runs
    evidence["detectability"] = nominal_map(Setting(SliderCrank(), "C"), 3e-4, 700.0, CHANNELS, [])
    assert len(render_report(diagnosis, evidence)) < 1.5e6


# ---- the clearance's profile


def test_the_profile_marks_the_estimate(show):
    page = show(*EXAMPLES["physics"]())
    marked = page.every("#better line.rule", "Number(one.getAttribute('x1'))")
    path = page.every(".columns path.line.after", "one.getAttribute('d')")
    assert len(path) == 1
    points = np.array([pair.split() for pair in re.split("[ML]", path[0])[1:]], float)
    lowest = points[np.argmax(points[:, 1]), 0]  # down the page is less misfit
    assert min(abs(x - lowest) for x in marked) < 6.0


# ---- what could be seen


@pytest.mark.parametrize("window", [{}, PHONE])
def test_the_map_marks_the_present_recording_and_says_cannot_be_seen_here(show, window):
    diagnosis, evidence = EXAMPLES["physics"]()
    page = show(diagnosis, evidence, **window)
    here = page.every(".detectability td.here [data-key]", "one.dataset.key")
    assert here == ["detectability.effects.0.size.all.1.2"]  # 0.31 mm, 690 rpm: nearest to 0.3 and 700
    box = page.run(
        "(({left, right}) => [left, right])(document.querySelector('td.here').getBoundingClientRect())"
    )
    assert 0 <= box[0] < box[1] <= window.get("width", 1280)
    choose(page, ".detectability select", 3)  # restitution
    cells = page.every(".detectability td", "one.innerText")
    assert cells.count("cannot be seen here") == 11
    page.run(
        "(() => { const one = document.querySelectorAll('.detectability select')[1];"
        "one.value = 1; one.dispatchEvent(new Event('change')); })()"
    )
    assert page.every(".detectability td.here", "1") == []  # other sensors than these
    words = page.run("document.querySelector('#seen').innerText")
    assert "cannot be seen here, which is not the same as absent" in words
    assert page.run("document.documentElement.scrollWidth") <= window.get("width", 1280)


def test_of_what_is_off_at_infinity_the_highest_value_that_is_seen_is_told(show):
    page = show(*EXAMPLES["physics"]())
    choose(page, ".detectability select", 4)  # a rod that bends
    words = page.run("document.querySelector('.detectability').innerText")
    assert "Highest frequency [Hz], damping ratio 0.01" in words
    assert "higher values can be seen" in words
    assert "root of a recording's length" not in words
    cells = page.every(".detectability td", "one.innerText")
    assert cells[0].startswith("at least 19")  # no weaker one was asked
    assert not any(cell.startswith("at ") for cell in cells[1:])
    shades = page.every(".detectability td", "one.className")
    assert "d4" in shades[0]  # the strongest colour
    choose(page, ".detectability select", 0)
    assert "Smallest coulomb force [N]" in page.run("document.querySelector('.detectability').innerText")


def test_the_stored_map_is_drawn(show):
    diagnosis, _ = EXAMPLES["physics"]()
    stored = nominal_map(Setting(SliderCrank(), "C"), 3e-4, -705.0, CHANNELS, [])
    page = show(diagnosis, {"detectability": stored}, **PHONE)
    assert len(page.every(".detectability td", "1")) == len(stored["clearance_m"]) * len(stored["speed_rpm"])
    place = next(i for i, e in enumerate(stored["effects"]) if e["name"] == "guide_friction")
    key = page.every(".detectability td.here [data-key]", "one.dataset.key")
    row, column = stored["clearance_m"].index(3e-4), stored["speed_rpm"].index(700.0)
    assert key == [f"detectability.effects.{place}.size.all.{row}.{column}"]


# ---- a sensor at fault


@pytest.mark.parametrize(
    ("channel", "marks"),
    [("crank_b_axial", 1), ("rod_b_axial", 1), ("rod_c_transverse", 1), ("slider_horizontal", 1), (None, 0)],
)
def test_a_faulty_sensor_is_marked_where_it_sits(show, channel, marks):
    diagnosis, evidence = EXAMPLES["instrument"]()
    diagnosis["recordings"][0]["channels"] = list(CHANNELS)
    effect = diagnosis["effects"][0]
    effect.update(channel=channel) if channel else effect.update(name="timebase", channel=None)
    page = show(diagnosis, evidence, **PHONE)
    assert len(page.every(".machine .fault", "1")) == marks
    assert page.every(".machine .arrow, .machine g.body.culprit", "1") == []
    if not channel:
        return
    assert page.every(".facts dd", "one.innerText")[0] == channel.replace("_", " ")
    for angle in (0, 90, 200, 300):
        page.put(".turning input", angle)
        middle = (
            "(({left, top, right, bottom}) => [(left + right) / 2, (top + bottom) / 2])"
            "(one.getBoundingClientRect())"
        )
        fault, label = page.every(".machine .fault", middle)[0], page.every(".culprit-label", middle)[0]
        assert np.hypot(fault[0] - label[0], fault[1] - label[1]) < 75
