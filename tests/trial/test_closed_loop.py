"""An estimator that goes on from the nominal one, on what a diagnosis corrected, beside the floor."""

from contextlib import nullcontext
from dataclasses import replace
from math import pi

import numpy as np
import pytest
import yaml
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from clearance.configuration import CONFIGURATION
from clearance.errors import InputError
from clearance.mechanism.applied_force import shares
from clearance.mechanism.description import read_path, write_mechanism
from clearance.mechanism.slider_crank import SliderCrank
from clearance.models.gauge import Estimate
from clearance.trial import closed_loop, pictures, trainings
from clearance.trial.case import Case, Session
from clearance.trial.closed_loop import (
    ESTIMATORS,
    Loop,
    _filled,
    close_loop,
    record,
    score,
    summarise,
    table,
    true_machine,
)
from clearance.trial.closed_loop import (
    LOOP as LOOP_FOLDER,
)
from clearance.trial.draw import Drawing, Scope
from clearance.trial.plant import ExtraForce
from clearance.trial.reveal import Revealed
from tests.trial.tool import verdict

NULL = Case(
    name="case_0001", kind="effect", joint="B", clearance=4e-4, sensors="all", encoder=True, noise=0.01,
    noise_seed=1, sessions=(Session(speed_rpm=700.0, start_angle=0.0, record_start=0.3, duration=0.2),),
)  # fmt: skip
LOOP = Loop(
    tests=2, clearance_range=(1e-4, 9e-4), speed_range=(600.0, 800.0), seconds=0.2, label_range=1e-3,
    train=(
        "experiment=smoke", "model=tcn", "model.net.widths=[8, 8]", "runs=6", "trainer.epochs=1",
        "trainer.accelerator=cpu", "trainer.threads=1", "split_seed=1",
    ),
    goes_on=("data_seed=2",), random=("campaign.random={joint_{other}.clearance: [0, 3e-4]}",),
)  # fmt: skip


@pytest.mark.parametrize(
    ("effect", "values", "path", "expected"),
    [
        ("guide_friction", {"coulomb_force": 4.2}, "guide_friction.coulomb_force", 4.2),
        ("gravity", {"gravity_y": -5.0}, "gravity.1", -5.0),
        ("second_clearance", {"clearance": 8e-5}, "joint_c.clearance", 8e-5),
        ("soft_drive", {"proportional": 1.0, "integral": 40.0}, "drive.integral", 40.0),
        ("soft_drive", {"stall_torque": 20.0, "no_load_ratio": 1.03}, "drive.stall_torque", 20.0),
        ("joint_lubrication", {"damping": 0.1}, "joint_b.film.damping", 0.1),
        ("worn_bearing", {"amplitude": 2e-5, "order": 3, "phase": 0.4}, "joint_b.bearing.order", 3),
        ("rod_inertia", {"mass_ratio": 1.15}, "rod.mass", 1.15 * SliderCrank().rod.mass),
    ],
)
def test_the_true_machine_has_the_case_s_numbers(effect, values, path, expected):
    machine = true_machine(replace(NULL, effects={effect: values}))
    assert read_path(machine, path) == pytest.approx(expected)
    assert machine.joint_b.clearance == 4e-4


def test_a_force_without_a_name_is_a_fine_table():
    force = {
        "of": "slider_by_position", "target": "slider_x", "argument": "slider_position", "kind": "bump",
        "size": 9.0, "centre": 0.12, "width": 0.01,
    }  # fmt: skip
    law = true_machine(replace(NULL, kind="outside", force=force)).force
    assert (law.body, law.direction, law.argument) == ("slider", "x", "slider_position")
    places = np.linspace(0.07, 0.171, 200)
    expected = ExtraForce(**{key: value for key, value in force.items() if key != "of"}).value(places)
    found = shares((places - law.start) / law.spacing, len(law.values), False, "cubic") @ law.values
    assert np.abs(found - expected).max() < 0.02 * 9.0
    turning = {**force, "target": "crank_torque", "argument": "crank_angle", "width": 2 * pi}
    assert true_machine(replace(NULL, force=turning)).force.spacing is None


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"items": ("slider_by_time",)}, r"slider_by_time is a force over time.*scope\.items"),
        ({"items": ("gravity",)}, r"slider_by_time is a force over time.*scope\.items"),  # any force
        ({"items": ("crank",), "known_frame": 0.1}, r"scope\.known_frame=0"),
        ({"items": ("crank",)}, None),
        ({"shares": {"effect": 1}}, None),
    ],
)
def test_a_case_that_cannot_be_trained_on_is_refused_before_it_is_drawn(wrong, said):
    scope = Scope(**{"shares": {"outside": 1}, "known_frame": 0.0, **wrong})
    with pytest.raises(InputError, match=said) if said else nullcontext():
        LOOP.check(scope)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"tests": 0}, r"tests = 0 is outside"),
        ({"train": None}, r"change loop\.train"),
        ({"random": "film=dry"}, r"change loop\.random"),
        ({"speed_range": (900.0, 500.0)}, r"change loop\.speed_range"),
    ],
)
def test_a_wrong_loop_is_refused(wrong, said):
    with pytest.raises(InputError, match=said):
        replace(LOOP, **wrong)


def test_a_scope_may_name_what_is_missing_and_how_much():
    scope = Scope(cases=5, shares={"effect": 4, "outside": 1}, items=("gravity", "crank"), sizes=(2,))
    cases = [Drawing(scope, 3).case(i) for i in range(5)]
    assert {case.missing for case in cases if case.kind == "effect"} == {("gravity",)}
    assert {case.force["of"] for case in cases if case.kind == "outside"} == {"crank"}
    assert {case.size for case in cases} == {2}
    assert not any(Drawing(replace(scope, known_frame=0.0), 3).case(i).known_frame for i in range(5))
    for wrong in (("ghost",), "gravity", None):
        with pytest.raises(InputError, match=r"scope\.items"):
            replace(scope, items=wrong)
    for wrong in ((), (5,), None):
        with pytest.raises(InputError, match=r"scope\.sizes"):
            replace(scope, sizes=wrong)


def test_a_worn_bore_is_not_closed_and_recordings_are_made_once(tmp_path):
    worn = replace(NULL, effects={"worn_bearing": {"amplitude": 2e-4, "order": 2, "phase": 0.0}})
    made = record(worn, tmp_path, LOOP, 1)
    assert [clearance for _, clearance in made] == pytest.approx([5.25e-4, 7.75e-4])
    before = [path.stat().st_mtime_ns for path, _ in made]
    assert record(worn, tmp_path, LOOP, 1) == made
    assert [path.stat().st_mtime_ns for path, _ in made] == before
    for other, loop in ((worn, replace(LOOP, tests=4)), (replace(worn, joint="C"), LOOP)):
        with pytest.raises(InputError, match="another machine or loop"):
            record(other, tmp_path, loop, 1)


HEAVY = replace(NULL, effects={"gravity": {"gravity_y": -9.81}})


def revealed(case, clearance=3e-4, corrected=None):
    said = verdict("physics", [{"name": "gravity", "kind": "physics", "parameters": {}}], clearance)
    return Revealed(case, {}, said, 10.0, None, corrected)


def read(values):
    return [Estimate("C", float(v), 0.0, 1e-3, 0.0, 1, v > 2e-4, "", None) for v in values]


def test_the_share_of_the_gap_to_the_floor_is_what_was_closed():
    true = np.array([1e-4, 5e-4])
    off = {"nominal": 1.1e-4, "corrected": 2e-5, "true": 1e-5, "random": 6e-5}
    loop = replace(LOOP, tests=3)
    rows = [
        score(revealed(HEAVY), true, {name: read(true + share * e) for name, e in off.items()}, loop)
        for share in (1, -3)
    ]
    assert rows[0]["error"] == pytest.approx({"nominal": 11, "corrected": 2, "true": 1, "random": 6})
    assert rows[0]["closed"] == pytest.approx(0.9)
    assert rows[0]["diagnosis_error"] == pytest.approx(10.0)
    assert rows[0]["trusted"] == {"nominal": 1.0, "corrected": 0.5, "true": 0.5, "random": 0.5}
    assert rows[0]["left_out"] == 1
    total = summarise(rows)
    assert total["error"]["nominal"] == pytest.approx(22.0)
    assert (total["closed"], total["closed_by_random"]) == pytest.approx((0.9, 0.5))
    line = "| mean |  | 22.00 % | 4.00 % | 2.00 % | 90% (shares: 90%) | 12.00 % (closes 50%) | 10.000 % |"
    assert line in table(rows)
    open_still = {name: read(true + e) for name, e in (off | {"corrected": off["nominal"]}).items()}
    total = summarise([*rows, score(revealed(HEAVY), true, open_still, loop)])
    assert total["closed"] == pytest.approx(0.72)  # a wide gap weighs more
    assert total["mean_of_shares"] == pytest.approx(0.6)
    equal = score(revealed(HEAVY), true, dict.fromkeys(off, read(true + 1e-6)), LOOP)
    assert equal["closed"] is None
    failed = replace(revealed(HEAVY), diagnosis=None, failure="exit | code")
    rows.append(score(failed, true, dict.fromkeys(off, read(true)), loop))
    assert "| gravity, joint B | no verdict |" in table(rows)
    assert "| mean (the diagnosis: of 2) |" in table(rows)


def test_the_loop_is_closed_once_for_every_case(tmp_path):
    write_mechanism(tmp_path / "said.yaml", replace(true_machine(HEAVY), gravity=(0.0, -9.5)))
    one = revealed(HEAVY, corrected=(tmp_path / "said.yaml").read_text())
    lines = []
    (row,) = close_loop([one], tmp_path, LOOP, 2, lines.append)
    assert set(row["error"]) == set(ESTIMATORS)
    assert len({tuple(values) for values in row["estimates_m"].values()}) == 4
    assert sum(line.startswith("training the") for line in lines) == 6
    assert "6 of 6" not in " ".join(lines)  # two rounds: none is begun before what it goes on from is there
    lines.clear()
    assert close_loop([one], tmp_path, LOOP, 1, lines.append) == [row]
    assert not any("training" in line for line in lines)
    (tmp_path / LOOP_FOLDER / "nominal_begun_B" / "plan.json").unlink()  # killed before it was written
    assert close_loop([one], tmp_path, LOOP, 1, lines.append) == [row]
    pictures.loop([row]).savefig(tmp_path / "loop.png")
    loop = tmp_path / LOOP_FOLDER
    for place, gravity, begin in (
        ("nominal_begun_B", 0.0, None), ("nominal_B", 0.0, "nominal_begun_B"),
        (f"{HEAVY.name}/corrected", -9.5, "nominal_begun_B"),
        (f"{HEAVY.name}/true", -9.81, "nominal_begun_B"),
        ("random_begun_B", 0.0, None), ("random_B", 0.0, "random_begun_B"),
    ):  # fmt: skip
        config = yaml.safe_load((loop / place / "config.yaml").read_text())
        assert config["campaign"]["mechanism"]["gravity"] == [0.0, gravity], place
        assert (config["begin"] and config["begin"].split("/")[-1]) == begin, place
        assert bool(config["campaign"]["random"]) == place.startswith("random")
        assert config["data_seed"] == (2 if begin else 1)


def test_a_bore_that_is_said_to_be_worn_is_not_closed_either(tmp_path):
    worn = replace(NULL, effects={"worn_bearing": {"amplitude": 1e-4, "order": 2, "phase": 0.0}})
    (tmp_path / HEAVY.name).mkdir()
    write_mechanism(tmp_path / "said.yaml", true_machine(worn))
    said = revealed(HEAVY, corrected=(tmp_path / "said.yaml").read_text())
    plans = closed_loop._plans(said, tmp_path, LOOP)
    low, high = LOOP.clearance_range
    for name in ESTIMATORS:
        least = 2e-4 if name == "corrected" else low
        assert f"campaign.clearance_range=[{least},{high}]" in plans[name].overrides


def test_a_corrected_machine_that_cannot_be_trained_on_counts_as_not_corrected(tmp_path, monkeypatch):
    def train(one, *_):
        if one.place.name == "corrected":
            raise InputError(f"{one.place}: a training ended with exit code 2")

    monkeypatch.setattr(trainings, "_train", train)
    (tmp_path / HEAVY.name).mkdir()
    write_mechanism(tmp_path / "said.yaml", true_machine(HEAVY))
    one, told = revealed(HEAVY, corrected=(tmp_path / "said.yaml").read_text()), []
    runs = closed_loop._trained([one], tmp_path, LOOP, 1, told.append)[HEAVY.name]
    assert runs["corrected"] == runs["nominal"] == tmp_path / "nominal_B"
    assert runs["true"] == tmp_path / HEAVY.name / "true"
    assert any("it counts as not corrected" in line for line in told)


def test_a_training_that_fails_is_told(tmp_path):
    wrong = replace(LOOP, train=("model=ghost",))
    with pytest.raises(
        InputError, match=r"nominal_begun_B: a training ended with exit code 2: error: .*ghost"
    ):
        close_loop([revealed(HEAVY)], tmp_path, wrong, 1, lambda _: None)


@pytest.mark.parametrize("joint", ["b", "c"])
def test_the_trainings_of_the_experiment_are_understood(joint):
    names = {"{joint}": joint, "{other}": "c" if joint == "b" else "b"}
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        loop = instantiate(compose("trial", ["experiment=closed_loop"]).loop, _convert_="all")
        for more in (loop.goes_on, loop.random):
            chosen = [f"joint={joint.upper()}", *loop.train, *(_filled(one, names) for one in more)]
            campaign = instantiate(compose("train", chosen).campaign, _convert_="all")
            machines = [campaign.machine(run) for run in range(12)]
            assert (len({machine.gravity for machine in machines}) > 1) == (more == loop.random)
            other = getattr(machines[0], f"joint_{names['{other}']}")
            assert (other.film.damping if more == loop.random else 0.0) == 0.0
