"""The list of what was tried."""

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.judging.evidence import _ranking
from clearance.diagnosis.judging.verdict import Estimate
from clearance.diagnosis.searching.explanation import Explanation
from tests.diagnosis.attempts import attempt, known


def labelled(name, misfit):
    found = attempt([name], misfit)
    found.hypotheses[0].label, found.hypotheses[0].direction = name, "x"
    found.hypotheses[0].body = "slider"
    return found


def test_parameters_of_two_effects_are_told_apart(monkeypatch):
    known(monkeypatch, lambda _: [Estimate(float(i), float(i), float(i)) for i in range(3)])
    pair = attempt(["worn_bearing", "sensor_gain"], 1.01)
    pair.hypotheses[1].kind, pair.hypotheses[1].channel = "instrument", "rod_c_axial"
    for one in pair.hypotheses:
        one.body, one.direction, one.label = "", "", one.name
    (row,) = _ranking(Explanation(attempt([], 90.0), [pair]), "mixed")
    values = {name: entry["value"] for name, entry in row["parameters"].items()}
    assert values == {"worn_bearing: size": 1.0, "sensor_gain of rod_c_axial: size": 2.0}
    assert row["kind"] == "mixed"


def test_what_the_motion_shows_is_listed_once_though_it_was_followed(monkeypatch):
    known(monkeypatch, lambda _: [Estimate(3e-4, 3e-4, 3e-4), Estimate(1.0, 0.9, 1.1)])
    pushed, spring = labelled(FREE_FORM, 1.01), labelled("slider_spring", 40.0)
    for shown, asserted in ((pushed, True), (None, False)):
        nominal = attempt([], 1.0)
        explanation = Explanation(nominal, [pushed, spring], shown=shown, shaken="shaken")
        rows = _ranking(explanation, "unknown")
        assert [row["name"] for row in rows] == [FREE_FORM, "slider_spring"]
        assert [row["asserted"] for row in rows] == [asserted, False]
    explanation = Explanation(attempt([], 90.0), [pushed, spring])
    for verdict in ("unknown", "physics"):  # what explains the fitted recordings may not the others
        rows = _ranking(explanation, verdict)
        assert [row["asserted"] for row in rows] == [verdict == "physics", False]
