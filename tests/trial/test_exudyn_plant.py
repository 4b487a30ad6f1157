"""The plant on Exudyn against the other plant and against closed forms; what a trial makes of its beams."""

import json
import sys
from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.trial import simulate as simulation
from clearance.trial.case import Case, Session
from clearance.trial.exudyn_plant import ExudynPlant, Model, load_exudyn
from clearance.trial.plant import ACCELERATIONS, CHANNELS, Plant
from clearance.trial.reveal import Revealed
from clearance.trial.score import score_case
from clearance.trial.summary import summarise
from clearance.trial.visibility import Scene, averaged, response
from tests.command_line import call
from tests.trial.tool import verdict

ANGLE, SPEED = 0.5, 700.0
BEAM = Case(
    name="case_0001", kind="beam", joint="C", clearance=1e-4, sensors="all", encoder=True, noise=0.01,
    noise_seed=1, effects={"rod_flexibility": {"frequency": 400.0, "damping_ratio": 0.02}}, size=2,
    sessions=(Session(speed_rpm=SPEED, start_angle=ANGLE, record_start=0.02, duration=0.02),),
)  # fmt: skip


@pytest.fixture(scope="module")
def exudyn():
    """Tests that ask for it are skipped where it is not installed."""
    pytest.importorskip("exudyn")


@pytest.fixture
def soon(monkeypatch):
    """Instants 5 ms apart, so that a case takes seconds."""
    monkeypatch.setattr(simulation, "AFTER", 0.05)


def machine(clearance, **changes):
    return Plant(joint="C", clearance=clearance, speed_rpm=SPEED, ramp=0.0, **changes)


def differences(signals, reference, first):
    """Root mean squares of what differs from time ``first`` on, over the deviation of each moving signal."""
    spread = np.std(reference, axis=0)
    live = spread > 1e-6  # of all units; three accelerations rest
    change = (signals - reference)[round(first * 1e5) :, live]
    return np.sqrt(np.mean(change**2, axis=0)) / spread[live]


@pytest.mark.parametrize(("clearance", "tolerance"), [(1e-4, 0.002), (8e-4, 0.02)])
def test_the_rigid_machine_is_that_of_the_other_plant(exudyn, clearance, tolerance):
    """Contact laws are equal, and so is the motion from 10 to 40 ms after the same start.

    Each sample at 100 kHz is compared. At 0.1 mm the journal stays in the bearing, only the scheme differs:
    (ωh)²/12 is 0.1 % of a contact that rings at 8 kHz with h = 2 µs. At 0.8 mm strikes add to it, which begin
    up to a step late and whose peaks, some steps wide, are compared as well. The first 10 ms hold the first
    strike of centred journals; from 50 ms on chaos magnifies what is left.
    """
    reference = machine(clearance).run(0.04, ANGLE, SPEED).signals
    found = ExudynPlant(clearance=clearance, speed_rpm=SPEED, start_angle=ANGLE).run(0.04).signals
    errors = differences(found, reference, 0.01)
    assert len(errors) == len(CHANNELS) - 3
    assert errors.max() < tolerance


def test_a_shorter_step_comes_nearer_to_the_other_plant(exudyn):
    """The first strike included: at least by the factor of a first-order scheme."""
    reference = machine(3e-4).run(0.012, ANGLE, SPEED).signals
    plant = ExudynPlant(clearance=3e-4, speed_rpm=SPEED, start_angle=ANGLE)
    runs = [replace(plant, step=step).run(0.012).signals for step in (5e-6, 2.5e-6, 1.25e-6)]
    errors = [differences(signals, reference, 0.0) for signals in runs]
    assert (errors[0] > 2.0 * errors[1]).all()
    assert (errors[1] > 2.0 * errors[2]).all()


@pytest.mark.parametrize("clearance", [1e-4, 8e-4])
def test_the_other_plant_goes_on_from_its_states(exudyn, clearance):
    """In contact and across the gap: what follows within 5 ms is the same, averaged as visibility is."""
    plant = machine(clearance)
    run = ExudynPlant(clearance=clearance, speed_rpm=SPEED, start_angle=ANGLE).run(0.046)
    for row in (1200, 2000, 4000):
        scene = Scene(0, row / 1e5, run.states[row], np.array([0.0, run.memory[row]]))
        there = averaged(run.signals[row : row + 500, : len(ACCELERATIONS)])
        change = response(plant, scene) - there
        assert np.abs(change).max() < 0.02 * np.std(there[:, -1]) + 0.5


def test_a_stiff_beam_is_a_rigid_rod(exudyn):
    """The rigid rod has the inertia of a uniform one, m l²/12, which is 0.8 % above the nominal one."""
    rigid = machine(1e-4, effects={"rod_inertia": {"inertia_ratio": 0.21 * 0.12**2 / 12.0 / 2.5e-4}})
    reference = rigid.run(0.03, ANGLE, SPEED).signals
    plant = ExudynPlant(clearance=1e-4, speed_rpm=SPEED, start_angle=ANGLE, step=2.5e-6)
    errors = [
        differences(replace(plant, rod_frequency=f).run(0.03).signals, reference, 0.01).max()
        for f in (2e3, 2e4, 2e5)
    ]
    assert errors[0] > 5.0 * errors[1]
    assert errors[1] > 2.0 * errors[2]
    assert errors[2] < 0.005  # what the step alone does, and a little more


def test_a_pinned_beam_rings_at_its_frequency(exudyn):
    """Free vibration from the first sine's velocity: frequency and damping ratio are those asked for."""
    plant = ExudynPlant(rod_frequency=400.0, damping_ratio=0.02, step=1e-5)
    model = Model(plant)
    rod = model.beam(np.zeros(2), np.zeros(2), 0.0, 0.0)
    frame = model.add("ObjectGround")
    for x, end in ((0.0, rod.at_b), (model.length, rod.at_c)):
        model.add("ObjectJointRevolute2D", markerNumbers=[model.marker(frame, x), end])
    contact = model.add("NodeGenericData", initialCoordinates=[0.0] * 4, numberOfDataCoordinates=4)
    for node, x in zip(rod.nodes, np.linspace(0.0, pi, len(rod.nodes)), strict=True):
        speed = [0.0, 1e-3 * np.sin(x), 0.0, 1e-3 * pi / model.length * np.cos(x)]  # and of the slope
        model.system.SetNodeParameter(node, "initialVelocities", speed)
    motions, _ = model.solve(1, 3000, [rod.nodes[plant.elements // 2]], contact)
    deflection = motions[0].place[:, 1]
    ups = np.flatnonzero((deflection[:-1] < 0.0) & (deflection[1:] >= 0.0))
    times = ups - deflection[ups] / (deflection[ups + 1] - deflection[ups])  # samples
    frequency = 1e5 / np.diff(times).mean()
    peaks = np.array([deflection[a:b].max() for a, b in pairwise(ups)])
    decrement = -np.diff(np.log(peaks)).mean()
    # six elements raise the frequency by 0.005 %, the step by 0.005 %; the peaks lie up to half a sample off
    assert frequency == pytest.approx(400.0 * np.sqrt(1.0 - 0.02**2), rel=1e-3)
    assert decrement / (2.0 * pi) == pytest.approx(0.02, rel=0.02)


def test_a_case_of_a_beam_is_scored_by_name_and_place(exudyn, soon):
    made = simulation.simulate(BEAM)
    assert set(made.recordings[0]) == {"time", *ACCELERATIONS, "crank_angle"}
    assert made.secrets["visibility"]["rod_flexibility"] > 1.0
    assert np.shape(made.secrets["responses"]) == (simulation.INSTANTS, 50, len(ACCELERATIONS))
    secrets = json.loads(json.dumps(made.secrets, allow_nan=False))
    number = {"value": 410.0, "unit": "Hz", "low": 409.0, "high": 411.0}
    effect = {"name": "rod_flexibility", "kind": "physics", "parameters": {"frequency": number}}
    place = {"detected": True, "body": "rod", "direction": "transverse"}
    said = verdict("physics", [effect], clearance=1e-4, mismatch=place)
    row = score_case(Revealed(BEAM, secrets, said, 1.0, None))
    assert (row["right"], row["body_right"], row["direction_right"]) == (True, True, True)
    nothing = score_case(Revealed(BEAM, secrets, verdict(clearance=1e-4), 1.0, None))
    assert row["left_over"] < 0.7 * nothing["left_over"]  # one mode is nearer to a beam than a rigid rod
    summary = summarise([row])
    assert summary["named_or_equivalent"]["count"] == 1
    assert summary["parameter_coverage"]["of"] == 0
    assert summary["confusion"] == {"beam": {"rod_flexibility": 1}}


def test_a_rod_that_does_not_bend_shows_nothing(exudyn, soon, monkeypatch):
    rigid = ExudynPlant(clearance=BEAM.clearance, speed_rpm=SPEED, start_angle=ANGLE)
    monkeypatch.setattr(Case, "beam", lambda case, session: rigid)
    assert simulation.simulate(BEAM).secrets["visibility"]["rod_flexibility"] < 0.05


def test_a_wrong_plant_is_refused():
    with pytest.raises(ValueError, match="rod_frequency = 0"):
        ExudynPlant(rod_frequency=0.0)


def test_without_exudyn_a_trial_of_beams_is_refused_before_it_conceals(monkeypatch, capfd, tmp_path):
    monkeypatch.setitem(sys.modules, "exudyn", None)  # as if it were not there
    with pytest.raises(InputError, match="pip install"):
        load_exudyn()
    places = (f"folder={tmp_path}/trial", f"sealed={tmp_path}/sealed", f"hydra.run.dir={tmp_path}/run")
    code, told = call(monkeypatch, capfd, "trial.__main__", "experiment=trial_beam", "stage=conceal", *places)
    assert code == 2
    assert told.strip().splitlines()[-1].endswith("the second plant needs Exudyn: pip install '.[exudyn]'")
    assert not (tmp_path / "trial").exists()
    assert not (tmp_path / "sealed").exists()
