"""What names leave, as a force of free form: over the right argument, on the right body."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.motion import outcome
from clearance.diagnosis.motion.attempt import Findings, Remainder
from clearance.diagnosis.motion.linkage import Linkage
from clearance.diagnosis.motion.model import gather
from clearance.diagnosis.motion.outcome import diagnose
from clearance.diagnosis.motion.recordings import tracks_of
from clearance.diagnosis.motion.remainder import _size, described, remainder, table_of
from clearance.diagnosis.motion.search import Search
from clearance.mechanism.drive import DirectCurrentMotor
from clearance.mechanism.slider_crank import SliderCrank
from clearance.trial.plant.extra import ExtraForce
from tests.diagnosis.motion.test_motion import MOTOR, RPM, planted

SPEEDS = (100.0 * RPM, 3000.0 * RPM)
RIG = SliderCrank(drive=DirectCurrentMotor(1.0, 700.0))
BUMP = ExtraForce(
    target="slider_x", argument="slider_position", kind="bump", size=8.0, centre=0.12, width=0.015
)
PULSE = ExtraForce(
    target="crank_torque", argument="crank_angle", kind="random_periodic", size=0.3, width=2.0 * np.pi, seed=3
)


def searched(recording, names):
    """The search of a recording in short stretches, and the nominal machine there."""
    tracks, _ = tracks_of({"rig": recording}, {})
    machine = Setting(RIG, "C").with_clearance(0.0)
    terms = gather(load_effects(names), machine, "C", tracks, [], 10.0)
    search = Search(tracks, machine, "C", terms, {}, Linkage(), SPEEDS, 1e9, 1, lambda _: None)
    search.turns = 2.5
    search.tracks = [track.filtered(True) for track in search.cut(tracks)]
    search.begin = search.beginnings(search.tracks)
    return search, search.attempt((), search.nominal_values(), search.begin, staged=True)


def test_a_plausible_force_is_of_the_whole_run_not_of_its_first_sample():
    form = SimpleNamespace(direction="x")
    from_rest = np.linspace(0.0, 70.0, 200)
    assert _size(RIG, from_rest, form) == pytest.approx(_size(RIG, np.full(200, 70.0), form) / 3.0, rel=0.01)


@pytest.mark.parametrize(
    ("force", "body"), [(BUMP, "slider"), pytest.param(PULSE, "crank", marks=pytest.mark.slow)]
)
def test_a_force_without_a_name_is_a_table_over_the_right_argument(force, body):
    search, nominal = searched(planted(2.5, 200.0, effects={"soft_drive": MOTOR}, extra=force), [])
    left = remainder(search, nominal, named=False)
    law, found = table_of(left), described(left)
    assert (law.body, law.argument) == (body, force.argument)
    place, value = np.array(found["table"]).T
    # at the ends of a stroke nothing moves the crank
    inner = slice(4, -4) if body == "slider" else slice(None)
    true = force.value(place)
    assert np.corrcoef(value[inner], true[inner])[0, 1] > 0.9
    low, high = np.array(found["low"]), np.array(found["high"])
    assert ((np.abs(value - true) < 2.0 * (high - low))[inner]).mean() > 0.9
    assert np.median(high - low) < 0.5 * np.ptp(true)
    slope = np.polyfit(true[inner] - true[inner].mean(), value[inner] - value[inner].mean(), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.2)
    assert not left.beside


@pytest.mark.slow
def test_beside_names_that_explain_their_numbers_stay():
    recording = planted(
        4.0, 200.0, effects={"soft_drive": MOTOR, "gravity": {"gravity_x": -5.0}}, extra=PULSE
    )
    search, nominal = searched(recording, ["gravity"])
    term = search.terms["gravity(gravity_x)"]
    named = search.attempt((term,), np.append(nominal.fit.shared, -5.0), nominal.fit.own)
    left = remainder(search, named, named=True)
    assert left.beside
    assert table_of(left).argument == "crank_angle"
    machine, _ = left.attempt.fit.model.apply(left.attempt.fit.shared)
    assert machine.gravity[0] == pytest.approx(named.fit.shared[-1])


def test_nothing_is_made_of_noise():
    search, nominal = searched(planted(2.5, 200.0, effects={"soft_drive": MOTOR}), [])
    assert remainder(search, nominal, named=False) is None


@pytest.mark.slow
def test_the_whole_diagnosis_is_unknown_on_the_right_body_and_explains():
    recording = planted(6.0, 200.0, effects={"soft_drive": MOTOR}, extra=BUMP)
    found = diagnose(
        *tracks_of({"rig": recording}, {}), Setting(RIG, "C"),
        load_effects(["gravity", "guide_friction", "slider_spring", "torque_ripple"]), {}, True, SPEEDS,
        seconds=600.0, workers=1, most=2, report=lambda _: None,
    )  # fmt: skip
    said = found.diagnosis
    assert said["verdict"] == "unknown"
    assert (said["mismatch"]["body"], said["free_form"]["argument"]) == ("slider", "slider_position")
    assert said["fit"]["held_out"]["before"] > 5.0
    assert said["fit"]["held_out"]["after"] < 1.2
    assert "a force on the slider, along x that depends on slider position" in said["summary"][0]
    assert found.machine.force.argument == "slider_position"


@pytest.mark.parametrize(
    ("after", "beside", "kept"),
    [(1.4, False, False), (1.4, True, True), (30.0, False, True)],
)
def test_a_table_in_the_place_of_names_is_dropped_where_these_explain_what_was_held_out(
    monkeypatch, after, beside, kept
):
    class Errors(SimpleNamespace):
        def score(self, noise):
            return self.error

    explained = SimpleNamespace(noise=np.ones(1), enough=False)
    monkeypatch.setattr(outcome, "Judged", lambda *_: Errors(error=1.0, explained=explained))
    best = SimpleNamespace(terms=[SimpleNamespace(effect=SimpleNamespace(kind="physics"))])
    left = Remainder(SimpleNamespace(), beside)
    findings = Findings(best, best, enough=SimpleNamespace(enough=False), left=left)
    before, named = (Errors(error=error, explained=explained) for error in (169.0, after))
    found = outcome._with_table(None, findings, before, named, [], SPEEDS)
    assert (found is not None) == kept == (findings.left is left)
