"""The paper's tables: which trainings they consist of, and that every number comes from a file."""

import json
import shutil

import pytest
import yaml

from clearance.errors import InputError
from clearance.evaluate import renewed
from clearance.evaluation.paper.estimates import PredictedAgainstTrue
from clearance.evaluation.paper.perturbation import PERTURBED
from clearance.evaluation.paper.results import TITLES, results, write_results
from clearance.evaluation.paper.tables import comparisons, paper_numbers, perturbed, row_name, table
from clearance.evaluation.paper.trainings import (
    Setting,
    Training,
    finished_trainings,
    known_trainings,
    reduction,
    reductions,
    trainings_of,
)
from tests.command_line import ROOT
from tests.study_folder import finish

SPLITS = (98, 42, 1024)
LSTM, TDNN = Setting("lstm"), Setting("tdnn")


def collected(folder):
    return {one.training: one for one in finished_trainings(folder)}


@pytest.mark.parametrize(
    ("experiment", "settings", "trainings"),
    [("table5", 2, 6), ("table6", 3, 90), ("tdnn_variants", 3, 90), ("table8", 3, 90), ("table9", 12, 36),
     ("decimation", 4, 12), ("placement", 7, 21)],
)  # fmt: skip
def test_tables_have_the_papers_settings_splits_and_initialisations(experiment, settings, trainings):
    found = trainings_of(experiment)
    assert (len({one.setting for one in found}), len(found)) == (settings, trainings)
    assert {one.split_seed for one in found} == set(SPLITS)
    assert {one.setting.joint for one in found} == {"B" if experiment == "table8" else "C"}
    assert found[0].split_seed == 98  # the figures' split comes first
    assert found[0].seed == 42


def test_every_setting_of_a_table_has_the_papers_numbers():
    for experiment in set(TITLES) - {"decimation", "placement", "table7"}:
        for setting in {one.setting for one in trainings_of(experiment)}:
            numbers = paper_numbers()[experiment]
            numbers = numbers[setting.sensors] if experiment == "table9" else numbers
            assert {"nmae", "nrmse"} <= set(numbers[setting.model]), row_name(experiment, setting)


def test_the_papers_numbers_are_the_papers():
    numbers = paper_numbers()
    assert numbers["table5"]["xgboost"] == {
        "nmae": 9.3, "nrmse": 11.94, "training": 49.88, "evaluation": 0.01
    }  # fmt: skip
    assert numbers["table6"]["lstm"] == {
        "nmae": [0.49, 0.14], "nrmse": [0.8, 0.19], "median_ae": [3.43, 1.23], "p95_ae": [13.6, 3.75],
        "training": [1369, 380.6], "evaluation": [0.89, 0.02],
    }  # fmt: skip
    assert numbers["tdnn_variants"]["tdnn_average"] == {"nmae": [2.39, 0.45], "nrmse": [3.33, 0.53]}
    nmae = {name: one["nmae"] for name, one in numbers["table8"].items()}
    assert nmae == {"tdnn": [1.12, 0.14], "lstm": [0.38, 0.13], "gru": [0.44, 0.12]}
    nrmse = {name: (one["lstm"]["nrmse"], one["gru"]["nrmse"]) for name, one in numbers["table9"].items()}
    assert nrmse == {
        "rod": ([0.67, 0.11], [0.84, 0.28]), "all": ([0.77, 0.21], [0.75, 0.02]),
        "no_slider": ([0.77, 0.07], [0.7, 0.11]), "no_crank": ([0.64, 0.16], [0.67, 0.22]),
        "no_rod": ([0.64, 0.07], [0.71, 0.33]), "crank": ([1.3, 0.65], [0.87, 0.17]),
    }  # fmt: skip
    for model, errors in (
        ("lstm", [[1.48, 0.44], [0.95, 0.36], [1.07, 0.32], [0.84, 0.19], [0.82, 0.18]]),
        ("gru", [[1.44, 0.43], [0.93, 0.38], [0.97, 0.37], [0.79, 0.26], [0.77, 0.25]]),
        ("tdnn", [[3.21, 0.15], [2.41, 0.2], [2.86, 0.17], [2.21, 0.17], [2.19, 0.27]]),
    ):
        own = numbers["table7"][model]
        scenarios = ("restitution", "stiffness", "hunt_crossley", "all", "noise")
        assert [own[name]["nrmse"] for name in scenarios] == errors
        # Table 7 repeats Table 6.
        assert own["base"] == {key: numbers["table6"][model][key] for key in own["base"]}


def test_rows_of_the_decimation_factor_say_which_samples_are_kept():
    names = [row_name("decimation", LSTM._replace(decimation=factor)) for factor in (1, 5)]
    assert names == ["every sample", "every 5th sample"]


@pytest.fixture(scope="module")
def reduced(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reduced")
    for split in SPLITS:
        for seed in (42, 98):
            shift = 0.01 * split / 1024 + 0.001 * (seed == 98)
            finish(folder, Training(LSTM, split, seed), 0.5 + shift, "scale=reduced")
            finish(folder, Training(TDNN, split, seed), 1.5 + 3 * shift, "scale=reduced")
    return folder


def test_a_row_holds_mean_deviation_interval_and_beneath_it_the_papers(reduced):
    lines = table("table6", trainings_of("table6"), collected(reduced)).splitlines()
    assert lines[2].startswith("| TDNN | 6 of 30 | 1.51 ± 0.01 [1.50, 1.53] | 3.03 ± 0.03 [3.00, 3.06] |")
    assert lines[3].startswith("| *paper* |  | *1.43 ± 0.19* | *2.19 ± 0.27* | *9.55 ± 1.52* |")
    assert lines[4].startswith("| LSTM | 6 of 30 | 0.50 ± 0.00 [0.50, 0.51] |")
    assert "| 60.00 ± 0.00 | 0.50 ± 0.00 |" in lines[4]
    assert len(lines) == 6  # no row of what is not trained


def test_models_are_compared_by_both_tests(reduced):
    lines = comparisons("table6", trainings_of("table6"), collected(reduced)).splitlines()
    assert lines[2].startswith("| TDNN - LSTM | NMAE [%] | 6 in 3 | +1.01 [")
    assert lines[2].endswith("| < 0.001 | < 0.001 | < 0.001 | yes |")


def test_the_correction_is_by_the_shares_of_the_trainings_that_are_compared(reduced, tmp_path):
    finish(tmp_path, Training(Setting("gru", joint="B"), 98, 42), 0.4, "data.split.train=0.4")
    found = collected(tmp_path) | collected(reduced)
    planned = trainings_of("table6")
    assert comparisons("table6", planned, found) == comparisons("table6", planned, collected(reduced))


def test_what_is_reduced_is_told_from_the_configurations(reduced):
    different = reductions(finished_trainings(reduced))
    assert different["runs", "150", "1000"] == {"lstm", "tdnn"}
    assert different["model.net.hidden_size", "128", "256"] == {"lstm"}
    assert different["model.net.filters", "64", "256"] == {"tdnn"}
    assert not [key for key, *_ in different if key.startswith("model.training")]


def test_a_training_of_the_papers_scale_is_not_called_reduced(tmp_path):
    finish(tmp_path, Training(LSTM, 98, 42), 0.5)
    found = finished_trainings(tmp_path)
    assert reductions(found) == {}
    text = results({one.training: one for one in found}, {})
    assert "**Scale: as in the paper.**" in text
    assert "Smaller" not in text


def test_the_report_says_scale_hardware_seeds_and_date_and_what_is_missing(reduced, tmp_path):
    write_results(reduced, tmp_path / "R.md", tmp_path / "pictures", {})
    text = (tmp_path / "R.md").read_text()
    assert "**Scale: smaller than the paper's.**" in text
    assert "- `trainer.loss._target_`: L1Loss (paper: MSELoss)" in text
    assert "- `model.net.filters`: 64 (paper: 256); TDNN\n" in text
    assert "12 trainings, 20" in text
    assert "P, 2 threads (torch 2)" in text
    assert "Seeds of the splits: 42, 98, 1024; of the initial weights: 42, 98" in text
    assert (
        text.count("*Smaller than the paper's scale: 150 recordings") == 5
    )  # tables 6 and 9, variants, decimation, placement
    assert text.count("Not measured yet.") == 3  # tables 5, 7 and 8
    rows = json.loads((tmp_path / "pictures/study.json").read_text())
    assert {(row["model"], row["split_seed"], row["seed"]) for row in rows} == {
        (model, split, seed) for model in ("lstm", "tdnn") for split in SPLITS for seed in (42, 98)
    }


def test_perturbed_errors_stand_beside_those_of_the_test_recordings(tmp_path):
    finish(tmp_path, Training(LSTM, 98, 42), 0.5)
    (run,) = finished_trainings(tmp_path)
    assert perturbed(trainings_of("table6"), {run.training: run}) == ""
    errors = {"nmae": 0.7, "nrmse": 1.4, "median_ae": 4e-6, "p95_ae": 2e-5}
    content = {"recordings": 165, "perturbations": {"restitution": errors}}
    (run.path / "perturbed.json").write_text(json.dumps(content))
    (run,) = finished_trainings(tmp_path)
    lines = perturbed(trainings_of("table6"), {run.training: run}).splitlines()
    assert lines[2] == "| LSTM, test recordings | 1 | 0.50 | 1.00 | 2.50 | 15.00 |"
    assert lines[4] == "| LSTM, restitution +10/-20 % | 1 | 0.70 | 1.40 | 4.00 | 20.00 |"
    assert lines[5] == "| *paper* |  | *0.55 ± 0.16* | *1.48 ± 0.44* | *3.76 ± 1.3* | *14.3 ± 4.17* |"


def perturb(run, **errors):
    content = {name: {"nmae": e, "nrmse": e, "median_ae": e, "p95_ae": e} for name, e in errors.items()}
    (run.path / PERTURBED).write_text(json.dumps({"perturbations": content}))


def test_every_perturbation_that_was_measured_of_any_training_has_a_row(tmp_path):
    for seed in (42, 98):
        finish(tmp_path, Training(LSTM, 98, seed), 0.5)
    first, second = finished_trainings(tmp_path)
    perturb(first, restitution=0.7)
    perturb(second, noise=0.8, restitution=0.9)
    lines = perturbed(trainings_of("table6"), collected(tmp_path)).splitlines()
    names = [line.split(" | ")[:2] for line in lines[2:] if "paper" not in line]
    assert names == [
        ["| LSTM, test recordings", "2"], ["| LSTM, restitution +10/-20 %", "2"], ["| LSTM, 1 % noise", "1"],
    ]  # fmt: skip


@pytest.mark.parametrize(("nmae", "kept"), [(0.5, True), (0.6, False)])
def test_what_was_measured_of_the_same_weights_elsewhere_stays_in_the_record(tmp_path, nmae, kept):
    finish(tmp_path / "there", Training(LSTM, 98, 42), 0.5)
    (run,) = finished_trainings(tmp_path / "there")
    perturb(run, noise=0.8)
    write_results(tmp_path / "there", tmp_path / "R.md", tmp_path / "pictures", {})
    finish(tmp_path / "here", Training(LSTM, 98, 42), nmae)
    write_results(tmp_path / "here", tmp_path / "R.md", tmp_path / "pictures", {})
    (row,) = json.loads((tmp_path / "pictures/study.json").read_text())
    assert row["test"]["nmae"] == nmae
    assert bool(row["perturbed"]) == kept
    assert ("LSTM, 1 % noise" in (tmp_path / "R.md").read_text()) == kept


@pytest.mark.parametrize("lost", ["data", "data_seed", "sensors"])
def test_a_configuration_that_lacks_what_a_table_needs_is_no_training(tmp_path, lost):
    finish(tmp_path, Training(LSTM, 98, 42), 0.5)
    (run,) = finished_trainings(tmp_path)
    (run.path / "config.yaml").write_text(
        yaml.safe_dump({key: value for key, value in run.config.items() if key != lost})
    )
    with pytest.raises(InputError, match=r"no training of clearance\.train; set runs to another folder"):
        finished_trainings(tmp_path)


def test_a_damaged_measurement_of_a_training_is_named(tmp_path):
    finish(tmp_path, Training(LSTM, 98, 42), 0.5)
    (run,) = finished_trainings(tmp_path)
    (run.path / PERTURBED).write_text('{"asked": "165"}')
    with pytest.raises(InputError, match=r"perturbed.json: no errors by perturbation; remove it"):
        finished_trainings(tmp_path)


def test_two_versions_of_the_data_are_not_mixed(tmp_path):
    for seed, version in ((42, "v1.0"), (98, "v2.0")):
        stored = ("data=stored", f"data.source.path=data/{version}")
        finish(tmp_path, Training(LSTM, 98, seed), 0.5, *stored)
    reduced = [one.reduced for one in finished_trainings(tmp_path)]
    assert [one["data.source.path"][0] for one in reduced] == ["data/v1.0", "data/v2.0"]
    assert reduced[0]["data.source._target_"] == ("StoredSource", "SimulatedSource")
    with pytest.raises(InputError, match="trainings of lstm at different scales"):
        known_trainings(tmp_path, tmp_path / "none.json")


def test_two_scales_in_one_folder_are_refused(tmp_path):
    finish(tmp_path / "a", Training(LSTM, 98, 42), 0.5)
    finish(tmp_path / "b", Training(LSTM, 98, 42), 0.5, "scale=reduced")
    with pytest.raises(InputError, match="different scales; set runs"):
        finished_trainings(tmp_path)


def test_what_another_machine_trained_stays_in_the_report(reduced, tmp_path):
    write_results(reduced, tmp_path / "R.md", tmp_path / "pictures", {})
    before = (tmp_path / "R.md").read_text()
    (tmp_path / "pictures/figure8.png").write_bytes(b"drawn there")
    finish(tmp_path / "here", Training(Setting("gru"), 98, 42), 0.9, "scale=reduced")
    gru = {"figure8": PredictedAgainstTrue(["lstm", "gru"], "C", 98, 42)}
    write_results(tmp_path / "here", tmp_path / "R.md", tmp_path / "pictures", gru)
    after = (tmp_path / "R.md").read_text()
    assert "| GRU | 1 of 30; split 98 | 0.90 |" in after  # the others are of three
    after_as_before = after.replace("; splits 42, 98, 1024 |", " |")
    assert after_as_before != after
    assert set(before.splitlines()) - set(after_as_before.splitlines()) <= {
        line for line in before.splitlines() if not line.startswith("|")
    }
    assert (tmp_path / "pictures/figure8.png").read_bytes() == b"drawn there"  # its weights are not here
    assert "](pictures/figure8.png)" in after
    assert len(json.loads((tmp_path / "pictures/study.json").read_text())) == 13


def test_a_record_of_another_scale_is_not_mixed_in(reduced, tmp_path):
    write_results(reduced, tmp_path / "R.md", tmp_path / "pictures", {})
    finish(tmp_path / "here", Training(LSTM, 98, 123), 0.5)
    with pytest.raises(InputError, match=r"trainings of lstm at different scales: .*study\.json"):
        write_results(tmp_path / "here", tmp_path / "R.md", tmp_path / "pictures", {})


class Elsewhere:
    """A figure whose weights are on another machine."""

    def draw(self, found):
        return None


@pytest.mark.parametrize(
    ("page", "pictures"),
    [
        ("RESULTS.md", "docs/results/study/short"),
        ("docs/results/study/reduced/RESULTS.md", "docs/results/study/reduced"),
    ],
)
def test_the_committed_reports_are_what_their_records_make(tmp_path, page, pictures):
    shutil.copytree(ROOT / pictures, tmp_path / pictures)
    figures = {path.stem: Elsewhere() for path in sorted((tmp_path / pictures).glob("figure*.png"))}
    rows = json.loads((ROOT / "docs/results/trainings.json").read_text())
    write_results(tmp_path / "none", tmp_path / page, tmp_path / pictures, figures, rows)
    assert (tmp_path / page).read_text() == (ROOT / page).read_text()


def test_the_readmes_tables_are_what_the_committed_measurements_make():
    trainings, bench = (
        json.loads((ROOT / "docs/results" / name).read_text()) for name in ("trainings.json", "bench.json")
    )
    assert renewed(ROOT / "README.md", trainings, bench) == (ROOT / "README.md").read_text()


def test_a_training_to_come_is_reduced_as_a_finished_one_says(reduced):
    one = finished_trainings(reduced)[0]
    assert reduction(one.training.setting, "scale=reduced") == one.reduced
    assert reduction(one.training.setting) == {}
