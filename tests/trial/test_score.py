"""The score: counts that are known in advance, and errors of the tool that it must notice."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clearance.evaluation.results import marks
from clearance.trial import pictures
from clearance.trial.case import Case, Session
from clearance.trial.claim import NO_CURVE, likeness
from clearance.trial.conceal import COMMITMENT
from clearance.trial.examine import DIAGNOSIS, VERDICT, VERDICTS, Examiner
from clearance.trial.reveal import Revealed, reveal
from clearance.trial.score import parameters, score_case
from clearance.trial.seal import unlock
from clearance.trial.simulate import simulate
from clearance.trial.summary import failures, history, rate, summarise, table
from clearance.whole_files import read_json
from tests.command_line import ROOT, command, environment
from tests.trial.tool import verdict

SESSION = Session(speed_rpm=700.0, start_angle=0.4, record_start=0.25, duration=0.2)
FRICTION = Case(
    name="case_0001", kind="effect", joint="C", clearance=3e-4, sensors="all", encoder=True, noise=0.01,
    noise_seed=1, sessions=(SESSION,), effects={"guide_friction": {"coulomb_force": 4.0}}, size=1,
)  # fmt: skip
NOTHING = replace(FRICTION, kind="none", effects={})
FORCE = replace(
    FRICTION, kind="outside", effects={},
    force={"of": "slider_by_position", "target": "slider_x", "argument": "slider_position", "kind": "bump",
           "size": 6.0, "centre": 0.12, "width": 0.01},
)  # fmt: skip
FAULT = replace(
    FRICTION, kind="instrument", effects={},
    faults={"sensor_misalignment": {"channel": "rod_c_axial", "angle": 0.1}},
)  # fmt: skip
SLIDER = {"detected": True, "body": "slider", "direction": "x"}


def friction(force=4.0, half=0.2, name="guide_friction"):
    number = {"value": force, "unit": "N", "low": force - half, "high": force + half}
    return {"name": name, "kind": "physics", "probability": 0.9, "parameters": {"coulomb_force": number}}


@pytest.fixture(scope="module")
def secrets():
    return simulate(FRICTION).secrets


def scored(case, said, secrets, seconds=10.0, failure=None):
    shown = {name: 5.0 for name in case.missing}
    known = {**secrets, "visibility": shown, "curve": secrets["curve"] if case.force else None}
    return score_case(Revealed(case, known, said, seconds, failure))


def test_exact_intervals():
    # Clopper & Pearson: of 0 in n, the upper end is 1 - 0.025^(1/n)
    none = rate([False] * 100)
    assert (none["count"], none["low"]) == (0, 0.0)
    assert none["high"] == pytest.approx(1 - 0.025 ** (1 / 100))
    assert rate([True, False])["low"] == pytest.approx(0.012579, abs=1e-6)
    assert rate([])["rate"] is None


def test_nothing_missing(secrets):
    row = scored(NOTHING, verdict(), secrets)
    assert (row["right"], row["why"]) == (True, None)
    assert row["clearance"]["covered"]
    assert row["body_right"] is None
    alarm = scored(NOTHING, verdict("physics", [friction()]), secrets)
    assert (alarm["right"], alarm["why"]) == (False, "false alarm: guide_friction")
    both = summarise([row, alarm])
    assert both["false_alarms"]["count"] == 1
    assert both["confusion"]["none"] == {"guide_friction": 1, "none": 1}


def test_an_effect_named_in_its_place_with_its_size(secrets):
    row = scored(FRICTION, verdict("physics", [friction()], mismatch=SLIDER), secrets)
    assert row["right"]
    assert row["first_and_alone"]
    assert row["body_right"]
    assert row["direction_right"]
    (parameter,) = row["parameters"]
    assert (parameter["true"], parameter["covered"], parameter["error"]) == (4.0, True, 0.0)
    off = scored(FRICTION, verdict("physics", [friction(4.4)], mismatch={"body": "rod"}), secrets)
    assert off["right"]
    assert (off["body_right"], off["direction_right"]) == (False, False)
    assert not off["parameters"][0]["covered"]
    assert off["parameters"][0]["error"] == pytest.approx(0.1)
    more = friction()
    more["parameters"]["viscous_damping"] = {"value": 1.0, "unit": "N s/m", "low": 0.5, "high": 1.5}
    row = scored(FRICTION, verdict("physics", [more]), secrets)
    assert [(p["true"], p["covered"]) for p in row["parameters"]] == [(4.0, True), (0.0, False)]


def test_equivalents_count_as_named_but_not_as_first_and_alone(secrets):
    said = verdict(
        "ambiguous", [friction(name="slider_spring")], equivalent=[["slider_spring"], ["guide_friction"]]
    )
    row = scored(FRICTION, said, secrets)
    assert row["named_or_equivalent"]
    assert not row["first_and_alone"]
    assert summarise([row])["confusion"] == {"guide_friction": {"equivalent": 1}}


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (verdict(), "missed, 5.0 times the threshold"),
        (verdict("unknown"), "seen, but not named"),
        (verdict("physics", [friction(name="slider_spring")]), "named slider_spring instead"),
    ],
)
def test_every_failure_has_a_word_on_why(secrets, said, why):
    row = scored(FRICTION, said, secrets)
    assert (row["right"], row["why"]) == (False, why)
    assert why in failures(summarise([row]))


def test_a_case_without_a_verdict_counts_as_wrong(secrets):
    row = scored(FRICTION, None, secrets, failure="no verdict within 600 s")
    summary = summarise([row])
    assert summary["named_or_equivalent"]["rate"] == 0.0
    assert summary["without_verdict"] == 1
    assert "no verdict within 600 s" in failures(summary)
    assert summary["held_out_at_floor"]["of"] == 0  # of a program that knows no such error
    right = scored(FRICTION, verdict("physics", [friction()]), secrets)
    assert summarise([right, row])["held_out_at_floor"] == rate([True, False])
    held = right["held_out"]
    silent, partial = (
        {**right, "held_out": {**held, **more}} for more in ({"after": None}, {"shares": {"a": 0.5}})
    )
    assert summarise([right, silent, partial])["held_out_at_floor"] == rate([True, False, False])


def test_a_recording_that_was_lost_in_part_is_known_by_its_file_alone(secrets):
    said = verdict("physics", [friction()])
    whole = scored(FRICTION, said, secrets)
    said["fit"]["held_out"] |= {"shares": {"/somebody/cases/case_0001/1.parquet": 0.5}}
    row = scored(FRICTION, said, secrets)
    assert row["held_out"] == {**whole["held_out"], "shares": {"1.parquet": 0.5}}
    assert summarise([whole, row])["held_out_at_floor"] == rate([True, False])


def test_what_cannot_be_wrong_is_not_counted_as_right(secrets):
    """A whole number without an interval; a claim of numbers that no machine can have."""
    effect = friction()
    effect["parameters"]["order"] = {"value": 2.0, "unit": "", "low": 2.0, "high": 2.0}
    row = scored(FRICTION, verdict("physics", [effect], clearance=-1.0), secrets)
    assert all(one["parameter"] != "order" for one in row["parameters"])
    assert row["left_over"] is None
    assert summarise([row])["claims_borne_out"] == rate([False])


@pytest.mark.parametrize(("said", "covered"), [(3.0, []), (2.0, [False])])
def test_a_wrong_count_is_missed_and_a_right_one_no_estimate(said, covered):
    worn = replace(FRICTION, effects={"worn_bearing": {"amplitude": 2e-5, "order": 3, "phase": 0.3}})
    number = {"value": said, "unit": "-", "low": said, "high": said}
    rows = parameters(worn, [{"name": "worn_bearing", "parameters": {"order": number}}])
    assert [row["covered"] for row in rows] == covered


def test_a_fault_has_a_channel_and_may_be_given_in_degrees(secrets):
    angle = {"value": 5.7, "unit": "deg", "low": 5.5, "high": 5.9}
    effect = {"name": "sensor_misalignment", "kind": "instrument", "channel": "rod_c_axial",
              "parameters": {"angle": angle}}  # fmt: skip
    place = {"body": "instrument", "direction": "along"}
    row = scored(FAULT, verdict("instrument", [effect], mismatch=place), secrets)
    assert row["right"]
    assert row["body_right"]
    assert row["parameters"][0]["covered"]
    wrong = scored(FAULT, verdict("instrument", [{**effect, "channel": "rod_b_axial"}]), secrets)
    assert wrong["why"] == "the right fault in the wrong channel"
    assert (wrong["named_or_equivalent"], wrong["first_and_alone"]) == (False, False)
    assert (wrong["spurious"], wrong["parameters"]) == (True, [])  # it says something else that is not there


@pytest.mark.parametrize(("channel", "named"), [("rod_c_axial", True), ("rod_b_axial", False)])
def test_a_fault_in_one_of_two_channels_is_not_named_alone(secrets, channel, named):
    effect = {"name": "sensor_misalignment", "kind": "instrument", "channel": channel, "parameters": {}}
    said = verdict("instrument", [effect], equivalent=[["sensor_misalignment"], ["sensor_misalignment"]])
    row = scored(FAULT, said, secrets)
    assert (row["named_or_equivalent"], row["first_and_alone"]) == (named, False)


@pytest.mark.parametrize(("channel", "named"), [("rod_c_axial", True), ("rod_b_axial", False)])
def test_a_fault_that_cannot_be_told_from_another_is_named_where_that_is_in_its_channel(
    secrets, channel, named
):
    effect = {"name": "sensor_gain", "kind": "instrument", "channel": channel, "parameters": {}}
    said = verdict("ambiguous", [effect], equivalent=[["sensor_gain"], ["sensor_misalignment"]])
    row = scored(FAULT, said, secrets)
    assert (row["named_or_equivalent"], row["first_and_alone"]) == (named, False)


def test_a_name_beside_which_nothing_is_asserted_names_nothing(secrets):
    said = verdict("unknown", equivalent=[["free_form"], ["guide_friction"]])
    assert not scored(FRICTION, said, secrets)["named_or_equivalent"]


def test_the_same_fault_in_two_channels_is_not_one_alone(secrets):
    effect = {"name": "sensor_misalignment", "kind": "instrument", "channel": "rod_c_axial", "parameters": {}}
    said = verdict("instrument", [effect, {**effect, "channel": "rod_b_axial"}])
    row = scored(FAULT, said, secrets)
    assert (row["named_or_equivalent"], row["first_and_alone"], row["spurious"]) == (True, False, True)


def test_the_spread_of_models_of_which_none_explains_covers_nothing(secrets):
    said = verdict("unknown")
    assert scored(FRICTION, said, secrets)["clearance"]["covered"]
    said["clearance"]["basis"] = "nearest models"
    assert scored(FRICTION, said, secrets)["clearance"]["covered"] is None


def test_a_drive_named_in_another_form_misses_its_parameters():
    soft = replace(FRICTION, effects={"soft_drive": {"proportional": 1.0, "integral": 40.0}})
    given = {"value": 8.0, "unit": "N m", "low": 7.0, "high": 9.0}
    rows = parameters(soft, [{"name": "soft_drive", "parameters": {"stall_torque": given}}])
    assert [(row["true"], row["covered"], row["error"]) for row in rows] == [(None, False, None)]


def test_what_is_asserted_beside_the_truth_is_counted(secrets):
    both = scored(FRICTION, verdict("physics", [friction(), friction(name="slider_spring")]), secrets)
    assert both["right"]
    right = scored(FRICTION, verdict("physics", [friction()]), secrets)
    assert summarise([both, right, scored(NOTHING, verdict(), secrets)])["spurious"] == rate(
        [True, False, False]
    )


def test_what_is_below_the_threshold_is_counted_apart(secrets):
    missed = scored(FRICTION, verdict(), secrets)
    seen = scored(FRICTION, verdict("physics", [friction()]), secrets)
    summary = summarise([{**missed, "visible": False}, seen])
    assert summary["named_or_equivalent"] == rate([True])
    assert summary["named_of_all"] == rate([True, False])
    assert summary["below_threshold"] == 1
    pairs = summarise([{**missed, "kind": "pair", "visible": False}, {**seen, "kind": "pair"}])
    assert (pairs["pairs_named_or_equivalent"], pairs["pairs_named_of_all"]) == (
        rate([True]), rate([False, True])
    )  # fmt: skip


def test_of_several_things_each_counts_and_all_of_them(secrets):
    triple = replace(
        FRICTION,
        kind="triple",
        effects={**FRICTION.effects, "torque_ripple": {"amplitude": 1.0}, "gravity": {}},
    )
    two = [friction(), friction(name="torque_ripple")]
    rows = [
        scored(triple, verdict("physics" if effects else "unknown", effects, mismatch=SLIDER), secrets)
        for effects in (two, [*two, friction(name="gravity")], [])
    ]
    summary = summarise(rows)
    assert [(summary[key]["count"], summary[key]["of"]) for key in (
        "triples_named_or_equivalent", "several_named", "pairs_named_or_equivalent", "named_or_equivalent")
    ] == [(1, 3), (5, 9), (0, 0), (0, 0)]  # fmt: skip
    assert "pairs:" not in table(summary)  # of which there is none
    assert summary["confusion"]["triple"] == {"guide_friction": 1, "triple": 1, "unknown": 1}


def test_body_and_direction_are_those_of_one_thing_that_is_missing(secrets):
    pair = replace(FRICTION, kind="pair", effects={**FRICTION.effects, "torque_ripple": {"amplitude": 1.0}})
    for body, direction, right in (("slider", "x", True), ("crank", "torque", True), ("crank", "x", False)):
        row = scored(pair, verdict("unknown", mismatch={"body": body, "direction": direction}), secrets)
        assert (row["body_right"], row["direction_right"]) == (True, right)


def test_a_force_outside_the_list():
    secrets = simulate(FORCE).secrets
    assert secrets["visibility"]["force"] > 1.0
    free = {
        "body": "slider",
        "direction": "x",
        "argument": "slider_position",
        "table": [[0.09, 0.0], [0.11, 3.6], [0.12, 6.0], [0.13, 3.6], [0.15, 0.0]],
    }
    said = verdict("unknown", mismatch=SLIDER, free_form=free)
    row = scored(FORCE, said, secrets)
    assert row["right"]
    assert row["curve_correlation"] > 0.95
    assert row["curve_error"] < 0.3
    assert row["left_over"] is None
    points = row["curve"]
    assert points["argument"] == sorted(points["argument"])
    assert (points["over"], points["direction"]) == ("slider_position", "x")
    assert np.corrcoef(points["true"], points["found"])[0, 1] == pytest.approx(
        row["curve_correlation"], abs=0.05
    )
    (panel,) = pictures.curves([row, {**row, "visible": False}]).axes
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("slider position [m]", "[N]")
    drawn = {line.get_label(): line.get_ydata().tolist() for line in panel.lines}
    assert drawn == {"true": points["true"], "found": points["found"]}
    larger = {**free, "table": [[x, 10.0 * f] for x, f in free["table"]]}
    large = scored(FORCE, {**said, "free_form": larger}, secrets)
    assert large["curve_correlation"] == pytest.approx(row["curve_correlation"])
    assert large["curve_error"] > 5.0
    on_the_rod = {**said, "free_form": {**free, "body": "rod"}}
    assert scored(FORCE, on_the_rod, secrets)["curve_correlation"] == 0.0
    backwards = {"argument": "slider_position", "table": [[x, -f] for x, f in free["table"]]}
    assert likeness(secrets["curve"], backwards)[0] < -0.95
    assert likeness(secrets["curve"], {"argument": "time", "table": [[0, 1], [1, 1]]}) == NO_CURVE
    itself = {"argument": "force", "table": [[-9.0, -9.0], [9.0, 9.0]]}  # the truth, by which none can guess
    assert likeness(secrets["curve"], itself) == NO_CURVE
    elsewhere = scored(FORCE, {**said, "mismatch": {"body": "rod"}}, secrets)
    assert elsewhere["why"] == "unknown, rightly, but on the wrong body"
    named = scored(FORCE, verdict("physics", [friction(name="process_load")]), secrets)
    assert named["why"] == "named process_load, where no name is right"
    assert named["curve_correlation"] == 0.0
    hidden = {**row, "visible": False, "curve_correlation": 0.3}  # below the threshold no curve is asked for
    assert summarise([row, hidden, named])["curve_good"] == rate([True, False])
    assert scored(FRICTION, {**said, "verdict": "unknown"}, secrets)["curve_correlation"] is None


def score_of(trial, answers):
    trial.answer(answers)
    for path in trial.folder.glob("verdicts*"):
        path.rename(trial.folder.with_name(f"{path.name}_{len(list(trial.folder.parent.iterdir()))}"))
    trial.examine()
    _, cases = reveal(trial.folder, trial.sealed)
    rows = [score_case(one) for one in cases]
    return summarise(rows), rows


def right_answers(trial, factor=1.0, renamed=None):
    """What a perfect tool would say; or one whose numbers are off, or that mixes up two names."""
    answers = {}
    for part in trial.truth()["cases"]:
        case = Case.from_json(part["truth"])
        effects = [
            {"name": (renamed or {}).get(name, name), "kind": "physics", "parameters": {
                key: {"value": factor * v, "unit": "", "low": 0.99 * factor * v, "high": 1.01 * factor * v}
                for key, v in values.items()
            }}
            for name, values in case.effects.items()
        ]  # fmt: skip
        name = "unknown" if case.force else "physics" if effects else "none"
        answers[case.name] = verdict(name, effects, case.clearance)
    return answers


def test_a_mislabelled_hypothesis_lowers_the_score(trial):
    summary, rows = score_of(trial, right_answers(trial))
    assert summary["named_or_equivalent"]["rate"] == 1.0
    assert summary["claims_borne_out"]["rate"] == 1.0
    first, second = [row["missing"][0] for row in rows if row["kind"] == "effect"]
    swapped, _ = score_of(trial, right_answers(trial, renamed={first: second, second: first}))
    assert swapped["named_or_equivalent"]["rate"] == 0.0
    assert len(swapped["failures"]) > len(summary["failures"])


def test_a_leaked_held_out_set_lowers_the_score(trial):
    """A tool that has fitted its held-out data claims the floor with any numbers: the claims do not hold."""
    leaked, _ = score_of(trial, right_answers(trial, factor=1.6))
    assert leaked["held_out_at_floor"]["rate"] == 1.0
    assert leaked["named_or_equivalent"]["rate"] == 1.0
    assert leaked["claims_borne_out"]["rate"] < 1.0
    assert leaked["parameter_coverage"]["rate"] == 0.0


def test_estimates_that_are_far_off_can_be_drawn(secrets, tmp_path):
    rows = [scored(NOTHING, verdict(clearance=factor * 3e-4), secrets) for factor in (0.1, 3.0)]
    for some in (rows, rows[:1], rows[1:], []):
        pictures.estimates(some).savefig(tmp_path / "a.png")
    pictures.power(rows, summarise(rows)["power"]).savefig(tmp_path / "a.png")


def test_rates_and_errors_are_of_the_cases_that_they_name(secrets):
    """Right verdicts alone, all of them, those at 1 % noise: each over its own cases."""
    right = scored(FRICTION, verdict("physics", [friction()], clearance=3.03e-4), secrets)
    wrong = scored(
        FRICTION, verdict("physics", [friction(name="slider_spring")], clearance=5e-4), secrets, seconds=30.0
    )
    alarm = scored(NOTHING, verdict("physics", [friction(force=1.0)]), secrets)
    noisy = scored(replace(NOTHING, noise=0.05), verdict(), secrets)
    found = summarise([right, wrong])
    covered = [row["clearance"]["covered"] for row in (right, wrong)]
    assert covered[1] is False
    assert found["clearance_coverage"] == rate(covered[:1])
    assert found["clearance_coverage_of_all"] == rate(covered)
    assert found["clearance_error"]["of"] == 1
    assert found["clearance_error"]["median"] == pytest.approx(0.01)
    assert found["clearance_error_of_all"]["largest"] == pytest.approx(2.0 / 3.0)
    assert found["seconds"]["median"] == pytest.approx(20.0)
    assert found["parameter_error"]["of"] == sum(p["error"] is not None for p in right["parameters"])
    nulls = summarise([alarm, noisy])
    assert nulls["false_alarms"] == rate([True, False])
    assert nulls["false_alarms_at_1_percent"] == rate([True])


def test_a_power_curve_counts_each_case_in_the_bin_of_its_visibility(secrets):
    rows = [scored(FRICTION, verdict("physics", [friction()]), secrets) for _ in range(3)]
    missed = scored(FRICTION, verdict(), secrets)
    for row, shown in zip((*rows, missed), (0.7, 1.5, 30.0, 1.9), strict=True):
        row["visibility"] = {"guide_friction": shown}
    bins = summarise([*rows, missed])["power"]
    assert [one["right"]["of"] for one in bins] == [0, 1, 2, 0, 0, 1]
    assert [one["right"]["count"] for one in bins] == [0, 1, 1, 0, 0, 1]
    lines = pictures.power([*rows, missed], bins).axes[0]
    places = {
        one.get_label(): sorted(np.asarray(one.get_offsets())[:, 0].tolist()) for one in lines.collections
    }
    assert places == {"right": [0.7, 1.5, 30.0], "detected": [], "missed": [1.9]}
    by_effect = summarise([*rows, missed])["power_by_effect"]
    (panel, *unused) = pictures.power_by_effect(by_effect).axes
    assert panel.get_title() == "guide_friction"
    assert not any(axes.axison for axes in unused)
    (right,) = [one for one in panel.containers if one.get_label() == "right"]
    assert right.lines[0].get_ydata().tolist() == [1.0, 0.5, 1.0]
    (beside,) = lines.child_axes
    assert [one.get_text() for one in beside.get_yticklabels()] == ["3 of 4"]


def test_pictures_have_the_order_of_the_list_with_what_it_lacks_at_the_end():
    """Joint to instrument, as the repertoire has them, not by letter."""
    cells = {"timebase": {"timebase": 2}, "outside": {"unknown": 1}, "none": {"none": 3}}
    axes = pictures.confusion(cells | {"joint_friction": {"no verdict": 1}}).axes[0]
    names = [[one.get_text() for one in line] for line in (axes.get_yticklabels(), axes.get_xticklabels())]
    assert names == [
        ["none", "joint_friction", "timebase", "outside"], ["none", "timebase", "unknown", "no verdict"]
    ]  # fmt: skip


def test_a_result_is_plain_data_with_tables_and_pictures(trial, tmp_path):
    summary, rows = score_of(trial, right_answers(trial))
    assert json.loads(json.dumps({"summary": summary, "rows": rows}, allow_nan=False))["summary"] == summary
    assert "| false alarms where nothing is missing | 0 of 1 (0.0%)" in table(summary)
    for figure in (
        pictures.power(rows, summary["power"]),
        pictures.confusion(summary["confusion"]),
        pictures.estimates(rows),
        pictures.power_by_effect(summary["power_by_effect"]),
    ):
        figure.savefig(tmp_path / "a.png")
        assert (tmp_path / "a.png").stat().st_size > 5000


def test_published_trials_are_listed_newest_first():
    published = {
        path.name: json.loads(path.read_text()) for path in (ROOT / "docs/results").glob("trial-*.json")
    }
    lines = history(published).splitlines()
    assert len(lines) == 2 + len(published) > 3
    assert {line.count("|") for line in lines} == {lines[0].count("|")}
    dates = [line.split("|")[1].strip() for line in lines[2:]]
    assert dates == sorted(dates, reverse=True)
    row = next(line for line in lines if "[20261126]" in line)
    assert "| 48 | 0 | 0 of 5 | 21 of 22 | 1 of 4 | 37 of 39 | 12 of 13 |" in row


def test_a_trial_without_a_case_of_a_kind_is_listed_too(secrets):
    none_right = summarise([scored(FRICTION, verdict(), secrets)])
    assert none_right["clearance_error_at_best"]["of"] == 0
    row = history({"trial-1.json": {**none_right, "date": "2026-01-01", "seed": 1}}).splitlines()[-1]
    assert row.endswith("| none | 10 s |")


ARGUMENTS = ["time_limit=600", "hypotheses=[gravity,contact_stiffness,restitution,sensor_gain]"]
SMALL = (
    "seed=7", "folder=trial", "sealed=sealed", "parallel=2", "time_limit=600", "hydra.run.dir=run",
    "scope.cases=3", "scope.shares={none: 1, effect: 1, instrument: 0, pair: 0, outside: 1, left_out: 0}",
    "scope.items=[gravity,slider_by_position]", "scope.sizes=[2]", "scope.seconds=[0.5,0.5]",
    "scope.recordings=1",
    "scope.noise=[[0.01,1]]", "scope.sensors={all: 1, seven: 0, rod: 0}", "scope.encoder=1",
    "scope.known_frame=0", "scope.clearance_range=[5e-5,2e-4]", "results=published/trial-7.json",
    "history=page.md", "pictures=published/7",
    f"arguments={json.dumps(ARGUMENTS)}",
)  # fmt: skip


def ran(home, stage):
    done = subprocess.run(
        command("trial", *SMALL, f"stage={stage}"), cwd=home, env=environment(), capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """One null, one effect, one force outside the list: concealed, diagnosed where no truth lies, scored."""
    home = tmp_path_factory.mktemp("small")
    (home / "page.md").write_text("\n".join(marks("trials", "trial")))
    assert "commitment SHA-256" in ran(home, "conceal")
    (home / "sealed").rename(home / "gone")
    ran(home, "diagnose")
    (home / "gone").rename(home / "sealed")
    assert "verdicts committed" in ran(home, "reveal")
    yield home
    unlock(home / "sealed")


def alone(small, home, kind):
    """A trial of the one case of a kind, not diagnosed yet."""
    (row,) = [
        row for row in json.loads((small / "trial/result.json").read_text())["rows"] if row["kind"] == kind
    ]
    shutil.copytree(small / "trial/cases" / row["name"], home / "cases" / row["name"])
    shutil.copy(small / "trial" / COMMITMENT, home)
    return row


def test_a_small_trial_of_the_tool_itself(small):
    summary = json.loads((small / "published/trial-7.json").read_text())
    assert summary["seed"] == 7
    assert summary["without_verdict"] == 0
    for score, expected in (("false_alarms", 0), ("first_and_alone", 1), ("unknown_with_body", 1)):
        assert (summary[score]["count"], summary[score]["of"]) == (expected, 1), score
    for name in ("power", "power_by_effect", "confusion", "estimates", "curves"):
        picture = (small / f"trial/{name}.png").read_bytes()
        assert len(picture) > 5000
        assert (small / f"published/7/{name}.png").read_bytes() == picture
    assert "| [7](published/trial-7.json) | 3 | 0 | 0 of 1 | 1 of 1 |" in (small / "page.md").read_text()


def test_the_tool_says_the_same_where_the_truth_can_be_read(small, tmp_path):
    """The first time it was gone; now it lies open beside the recordings."""
    row = alone(small, tmp_path, "none")
    unlock(small / "sealed")
    shutil.copytree(small / "sealed", tmp_path / "sealed")
    Examiner(DIAGNOSIS, ARGUMENTS).examine(tmp_path, 1, lambda line: None)
    first, second = (
        json.loads(path.read_text().replace(str(path.parents[2]), ""))
        for path in (home / VERDICTS / row["name"] / "diagnosis.json" for home in (small / "trial", tmp_path))
    )
    changing = ("seconds", "peak_memory_mib")
    assert {k: v for k, v in first.items() if k not in changing} == {
        k: v for k, v in second.items() if k not in changing
    }


@pytest.mark.slow
def test_a_name_that_is_wrong_in_the_tool_lowers_its_score(small, tmp_path):
    """The tool itself, whose law of gravity goes by another name, asked about the machine with gravity."""
    row = alone(small, tmp_path, "effect")
    assert row["named_or_equivalent"]
    program = [sys.executable, str(Path(__file__).with_name("planted.py")), "workers=1", "finished=null"]
    Examiner(program, ARGUMENTS).examine(tmp_path, 1, lambda line: None)
    said = read_json(tmp_path / VERDICTS / row["name"] / VERDICT)
    assert said["failure"] is None
    _, cases = reveal(small / "trial", small / "sealed")
    (one,) = [one for one in cases if one.case.name == row["name"]]
    planted = score_case(replace(one, diagnosis=said["diagnosis"]))
    assert planted["named"] == ["slider_offset"]
    assert not planted["right"]
    assert planted["spurious"]
    wrong = summarise([planted])
    assert wrong["named_or_equivalent"]["count"] == wrong["claims_borne_out"]["count"] == 0
