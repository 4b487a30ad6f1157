"""The paper's tables: which trainings they consist of, and that every number comes from a file."""

import json

import pytest

from clearance.errors import InputError
from clearance.evaluation.paper.estimates import PredictedAgainstTrue
from clearance.evaluation.paper.results import TITLES, results, write_results
from clearance.evaluation.paper.tables import comparisons, paper_numbers, perturbed, row_name, table
from clearance.evaluation.paper.trainings import (
    Setting,
    Training,
    finished_trainings,
    reduction,
    reductions,
    trainings_of,
)
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


def test_a_training_to_come_is_reduced_as_a_finished_one_says(reduced):
    one = finished_trainings(reduced)[0]
    assert reduction(one.training.setting, "scale=reduced") == one.reduced
    assert reduction(one.training.setting) == {}
