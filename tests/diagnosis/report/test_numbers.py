"""The figures of the page are those of the diagnosis, rounded; bars and colours follow them."""

import numpy as np
import pytest

from tests.diagnosis.report.examples import EXAMPLES

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
    wanted |= set(held_out[:3])
    if diagnosis["verdict"] == "none":  # there is one model: what it was before is what it is
        wanted -= {"fit.held_out.before", "clearance.before_m"}
    assert wanted <= keys


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
    impacts = evidence["signatures"]["recordings"][0]["impacts"]
    after, before = (
        lengths[f"signatures.recordings.0.impacts.{kind}.per_revolution"] for kind in ("after", "before")
    )
    ratio = after / before
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
