"""Perturbed machines are the training's with another contact, and perturbed signals its own with noise."""

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from clearance import evaluate
from clearance.configuration import CONFIGURATION
from clearance.errors import InputError
from clearance.evaluation.paper.perturbation import NewRuns, NoisyTest, TrainingData, asked
from clearance.evaluation.paper.trainings import Setting, Training
from clearance.mechanism.contact import HuntCrossley, LankaraniNikravesh
from clearance.windows.splitting import RandomSplit
from tests.study_folder import finish


@pytest.fixture(scope="module")
def perturbations():
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return instantiate(compose("evaluate").perturbations, _convert_="all")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        cfg = compose("train", ["experiment=smoke", "runs=8"])
    campaign = instantiate(cfg.campaign, _convert_="all")
    folder = tmp_path_factory.mktemp("datasets")
    channels = tuple(cfg.sensors.channels)
    return TrainingData(campaign, folder, 0.1, channels, ("clearance_c",), RandomSplit(seed=3), 2**30)


def contacts(perturbation, data, runs=200):
    campaign = perturbation.campaign(data.campaign, runs)
    return [campaign.machine(run).joint_c.contact for run in range(runs)]


def test_each_scenario_draws_what_the_paper_says_and_nothing_else(perturbations, data):
    nominal = {(c.restitution, c.stiffness_scale) for c in contacts(perturbations["nominal"], data)}
    assert nominal == {(0.9, 1.0)}
    restitution = np.array([c.restitution for c in contacts(perturbations["restitution"], data)])
    assert 0.9 * 0.8 <= restitution.min() < 0.9 * 0.82
    assert 0.9 * 1.08 < restitution.max() <= 0.9 * 1.1
    stiffness = np.array([c.stiffness_scale for c in contacts(perturbations["stiffness"], data)])
    assert 0.8 <= stiffness.min() < 0.82 < 1.18 < stiffness.max() <= 1.2
    assert {type(c) for c in contacts(perturbations["stiffness"], data)} == {LankaraniNikravesh}
    assert contacts(perturbations["hunt_crossley"], data, 2) == [HuntCrossley()] * 2
    every = contacts(perturbations["all"], data)
    assert {type(c) for c in every} == {HuntCrossley}
    assert np.ptp([c.restitution for c in every]) > 0.2
    assert np.ptp([c.stiffness_scale for c in every]) > 0.35


def test_all_scenarios_have_the_same_new_clearances_and_speeds(perturbations, data):
    new = [p for p in perturbations.values() if isinstance(p, NewRuns)]
    labels = [p.campaign(data.campaign, 5).labels(range(5)) for p in new]
    assert all((one == labels[0]).all() for one in labels)
    assert not np.intersect1d(labels[0], data.campaign.labels(range(8))[:, 1:]).size


def test_noise_is_added_to_the_test_recordings_of_the_trainings_split(data):
    plain, noisy = data.test(), NoisyTest(0.01).recordings(data, 0)
    chosen = RandomSplit(seed=3).divide(np.arange(8)).test
    assert (plain.target == data.campaign.labels(range(8))[chosen, 1:2]).all()
    added = noisy.signals - plain.signals
    # the 4000 samples of each channel put the deviation within 1/sqrt(8000)
    assert added.std(axis=0) / plain.signals.std(axis=0) == pytest.approx(0.01, rel=0.1)
    assert (NoisyTest(0.01).recordings(data, 0).signals == noisy.signals).all()


def test_a_training_on_other_data_is_refused(tmp_path):
    (tmp_path / "config.yaml").write_text("targets: [clearance_c]\n")
    with pytest.raises(InputError, match=r"data=simulated.*set perturbed=0"):
        TrainingData.of(tmp_path)


def test_what_was_measured_of_other_perturbations_is_measured_again(tmp_path, perturbations, monkeypatch):
    finish(tmp_path, Training(Setting("lstm"), 98, 42), 0.5)
    (config,) = tmp_path.rglob("config.yaml")
    (config.parent / "model.safetensors").touch()
    measured = []
    monkeypatch.setattr(evaluate, "load_gauge", measured.append)

    def answer(gauge, data, perturbations, count, metrics):
        return {"asked": asked(perturbations, count), "perturbations": {}}

    monkeypatch.setattr(evaluate, "evaluate_perturbed", answer)
    louder = {**perturbations, "noise": NoisyTest(0.5)}
    for which, count in ((perturbations, 6), (perturbations, 6), (louder, 6), (louder, 6), (louder, 7)):
        evaluate.measure_perturbed(tmp_path, which, count)
    assert len(measured) == 3
