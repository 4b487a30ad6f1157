"""A slider seen through a loose joint: against a closed form, and against the simulator's own states."""

import numpy as np
import pytest

from clearance.diagnosis.kinematics.carried import Carried, tell_clearance
from clearance.diagnosis.kinematics.lift import suggest_gap
from clearance.diagnosis.kinematics.reconstruction import reconstruct
from clearance.mechanism.guide import LooseGuide
from clearance.simulation.layout import Signal, State
from clearance.simulation.shooting import ECCENTRICITY_C
from tests.diagnosis.kinematics import test_reconstruction as own

MASS, PERIOD, STIFFNESS = 0.14, 1e-4, 1e7


def rolling(clearance, strikes=0.0):
    """A journal that rolls to and fro in its bearing and moves a slider, which strikes rails at times."""
    time = PERIOD * np.arange(6000)
    swing = 2.0 * np.pi * 180.0
    angle = 0.4 * np.sin(swing * time)
    force = 90.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rate, bend = 0.4 * swing * np.cos(swing * time), -0.4 * swing**2 * np.sin(swing * time)
    aside = clearance * (np.cos(angle) * bend - np.sin(angle) * rate**2)
    slider = force[:, 1] / MASS
    rng = np.random.default_rng(5)
    slider += np.where(rng.random(len(time)) < strikes, 4000.0 * rng.normal(size=len(time)), 0.0)
    end = slider + aside + 0.5 * rng.normal(size=len(time))
    return Carried(end, force, 0.5, MASS, np.zeros(len(time)), PERIOD), slider


@pytest.mark.parametrize("strikes", [0.0, 0.04])
@pytest.mark.parametrize("clearance", [1e-4, 4e-4])
def test_the_clearance_is_that_with_which_the_force_moves_the_slider(clearance, strikes):
    carried, _ = rolling(clearance, strikes)
    found, left = tell_clearance([carried])
    assert found == pytest.approx(clearance, rel=0.05)
    assert left < 0.5


def test_what_the_rod_feels_less_the_bend_of_its_journal_s_way_is_what_the_slider_does():
    carried, slider = rolling(2e-4)
    found = carried.across(2e-4)
    inside = slice(50, -50)
    assert found.told.all()
    assert np.std((found.slider - slider)[inside]) < 0.1 * slider.std()
    assert np.abs(found.push[inside]).max() < 0.1 * MASS * np.abs(slider).max()


def looked_at(monkeypatch, clearance, gap, sensors=own.SENSORS):
    monkeypatch.setattr(own, "SENSORS", sensors)
    laws = {"guide": LooseGuide(gap=gap)} if gap else {}
    made = own.machine("C", clearance, **laws)
    measured, states = own.recorded(made)
    known = own.aligned(states)
    rough = own.machine("C", 1.4 * clearance)  # as a nominal machine that is not loose in its guide shows it
    return made, measured, states, known, reconstruct(
        measured, rough.parameters(), ("C",), known.speed, known.angle
    )  # fmt: skip


@pytest.mark.parametrize(("clearance", "gap"), [(7e-5, 7e-5), (2e-4, 2e-5), (4.3e-4, 3.5e-4)])
def test_clearance_and_gap_are_told_by_the_rod_and_a_sensor_along_the_guide(monkeypatch, clearance, gap):
    made, measured, states, known, path = looked_at(monkeypatch, clearance, gap)
    told, left = tell_clearance([path.carried])
    assert told == pytest.approx(clearance, rel=0.08)
    assert left < 0.6
    assert suggest_gap(path.carried.across(told), STIFFNESS, path.carried.period) == pytest.approx(
        gap, rel=0.3
    )
    found = reconstruct(measured, made.parameters(), ("C",), known.speed, known.angle)
    inside = slice(5, -5)
    true = states[:: own.SAMPLES][: len(found.nodes)][inside]
    height = np.abs(found.nodes[inside, State.SLIDER_Y] - true[:, State.SLIDER_Y])
    assert np.median(height) < 0.15 * gap
    journal = own.eccentricities(made, states, "C")[:: own.SAMPLES][: len(found.nodes)][inside]
    miss = np.abs(clearance * found.nodes[inside][:, list(ECCENTRICITY_C)] - journal)
    assert np.median(miss, axis=0) == pytest.approx([0.0, 0.0], abs=0.05 * clearance)


def test_the_rod_s_sensors_alone_tell_a_small_clearance_roughly(monkeypatch):
    rod = tuple(s for s in own.SENSORS if s.name.startswith("ROD"))
    *_, path = looked_at(monkeypatch, 7e-5, 7e-5, rod)
    told, _ = tell_clearance([path.carried])
    assert told == pytest.approx(7e-5, rel=0.35)  # the force is told worse, and blurs the journal's way
    assert suggest_gap(path.carried.across(told), STIFFNESS, path.carried.period) == pytest.approx(
        7e-5, rel=0.3
    )


@pytest.mark.parametrize("clearance", [7e-5, 4.3e-4])
def test_a_slider_that_is_held_shows_no_rails(monkeypatch, clearance):
    *_, path = looked_at(monkeypatch, clearance, 0.0)
    told, _ = tell_clearance([path.carried])
    assert suggest_gap(path.carried.across(told), STIFFNESS, path.carried.period) is None


def test_sensors_that_do_not_tell_the_rod_s_force_tell_nothing(monkeypatch):
    sensors = tuple(s for s in own.SENSORS if s is not Signal.ROD_B_TRANSVERSE)
    *_, path = looked_at(monkeypatch, 7e-5, 7e-5, sensors)
    assert path.carried is None
