import json

import numpy as np
import pytest
import torch
from lightning.pytorch.callbacks import ModelCheckpoint

from clearance.errors import InputError
from clearance.models.neural import Checkpoints
from tests.models.conftest import CONF, NEURAL, SMALL, configured


class Killed(Exception):
    pass


def test_every_model_is_tested():
    assert {path.stem for path in (CONF / "model").glob("*.yaml")} == set(SMALL)


def net_of(model, channels=2, length=60, outputs=1):
    torch.manual_seed(0)
    estimator = configured(model)
    estimator._build(channels, length, outputs)
    return estimator.net


@pytest.mark.parametrize("model", NEURAL)
def test_a_number_a_window_and_target_and_a_gradient_in_every_weight(model):
    net, signals = net_of(model, outputs=2), torch.randn(5, 60, 2)
    optimizer = torch.optim.SGD(net.parameters(), 1e-3)
    for _ in range(2):  # what a residual scale of zero hides at first shows after one step
        optimizer.zero_grad()
        output = net(signals)
        output.sum().backward()
        optimizer.step()
    assert output.shape == (5, 2)
    for name, weight in net.named_parameters():
        assert weight.grad is not None, name
        assert weight.grad.abs().sum() > 0, name


@pytest.mark.parametrize("model", NEURAL)
def test_one_batch_can_be_learnt_by_heart(model):
    net = net_of(model)
    signals, target = torch.randn(8, 60, 2), torch.linspace(0.1, 0.9, 8)[:, None]
    optimizer = torch.optim.Adam(net.parameters(), 1e-2)
    for _ in range(300):
        loss = torch.nn.functional.mse_loss(net(signals), target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if loss < 1e-3:
            break
    assert loss < 1e-3  # the targets' variance is 0.07


@pytest.mark.parametrize("model", SMALL)
def test_the_same_seed_gives_the_same_model_and_a_saved_model_the_same_answers(
    model, make_data, open_run, tmp_path
):
    answers = []
    for name, seed in (("one", 42), ("two", 42), ("three", 43)):
        data = make_data()
        estimator = configured(model)
        estimator.fit(data, open_run(name, seed))
        answers.append(estimator.predict(data.test_windows()))
        assert estimator.parameters > 0
        if name == "one":
            estimator.save(tmp_path)
            again = configured(model)
            again.load(tmp_path)
            assert np.array_equal(again.predict(data.test_windows()), answers[0])
    assert answers[0].shape == (len(data.test_windows()), 1)
    assert np.array_equal(answers[0], answers[1])
    if model != "xgboost":  # draws nothing at random
        assert not np.array_equal(answers[0], answers[2])


@pytest.mark.parametrize("model", SMALL)
def test_a_foreign_file_is_refused(model, tmp_path):
    for name in ("model.safetensors", "model.ubj"):
        (tmp_path / name).write_bytes(b"not a model" * 50)
    with pytest.raises(InputError, match="set checkpoint"):
        configured(model).load(tmp_path)


@pytest.mark.parametrize("model", ["lstm", "tcn"])
def test_a_killed_training_goes_on_to_the_same_weights(model, make_data, open_run):
    whole = configured(model, "trainer.epochs=4")
    whole.fit(make_data(), open_run("whole"))
    run = killed_at(2, configured(model, "trainer.epochs=4"), make_data(), open_run("killed"))
    assert (run.checkpoints / "last.ckpt").exists()
    resumed = configured(model, "trainer.epochs=4")
    resumed.fit(make_data(), run)
    for name, weight in whole.net.state_dict().items():
        assert torch.equal(weight, resumed.net.state_dict()[name]), name


@pytest.mark.parametrize("model", ["random_forest", "xgboost"])
def test_trees_take_as_many_threads_as_a_training_may(model, make_data, open_run):
    forest = model == "random_forest"
    estimator, run = configured(model, *(["model.jobs=-1"] if forest else [])), open_run()
    run.config["trainer"] = {"threads": 3}
    estimator.fit(make_data(), run)
    assert estimator.processors == (3, False)
    if not forest:
        used = json.loads(estimator.model.save_config())["learner"]["generic_param"]["nthread"]
        assert used == "3"


def test_a_forest_s_own_jobs_come_before_the_training_s_threads(make_data, open_run):
    estimator, run = configured("random_forest", "model.jobs=2"), open_run()
    run.config["trainer"] = {"threads": 3}
    estimator.fit(make_data(), run)
    assert estimator.processors == (2, False)


def test_checkpoints_of_lightnings_own_kind_are_taken_over():
    """Trainings that were begun before the folder could be moved."""
    settings = {"monitor": "val/nmae", "mode": "min"}
    assert Checkpoints(**settings).state_key == ModelCheckpoint(**settings).state_key


def test_a_killed_training_whose_folder_is_moved_knows_its_best_weights(make_data, open_run):
    still = ("trainer.epochs=3", "trainer.monitor=val/loss", "trainer.optimizer.lr=0")
    killed = killed_at(2, configured("lstm", *still), make_data(), open_run("killed"))
    killed.path.rename(killed.path.with_name("moved"))
    moved = open_run("moved")
    configured("lstm", *still).fit(make_data(), moved)
    epochs = [torch.load(moved.checkpoints / f"{name}.ckpt")["epoch"] for name in ("best", "last")]
    assert epochs == [0, 2]  # no later epoch was better than the first


def killed_at(epoch, estimator, data, run):
    """The folder of a training that did not come to the end of an epoch."""
    plain = data.train_dataloader

    def killed():
        if data.trainer.current_epoch == epoch:
            raise Killed
        return plain()

    data.train_dataloader = killed
    with pytest.raises(Killed):
        estimator.fit(data, run)
    return run


def test_a_training_begins_with_the_weights_of_another(make_data, open_run, tmp_path):
    first = configured("tcn", "trainer.epochs=1")
    first.fit(make_data(), open_run("first"))
    first.save(tmp_path)
    on = configured("tcn", "trainer.epochs=1", "trainer.optimizer.lr=0")
    on.begin(tmp_path)
    on.fit(make_data(), open_run("on"))
    learnt = dict(on.net.named_parameters())  # statistics of batch normalisation go on
    for name, weight in first.net.named_parameters():
        assert torch.equal(weight, learnt[name]), name
    with pytest.raises(InputError, match="set checkpoint or begin to a training of the same"):
        configured("lstm").begin(tmp_path)


def test_training_stops_when_validation_does_not_improve(make_data, open_run):
    estimator = configured(
        "lstm",
        "trainer.epochs=50",
        "trainer.patience=2",
        "trainer.optimizer.lr=0",
        "trainer.monitor=val/loss",
    )
    run = open_run()
    estimator.fit(make_data(), run)
    last = torch.load(run.checkpoints / "last.ckpt", weights_only=True)
    assert last["epoch"] == 2  # the first epoch is best, two more are not better
    # killed after that, while its interval was calibrated
    again = configured("lstm", "trainer.epochs=50", "trainer.patience=2", "trainer.monitor=val/loss")
    again.fit(make_data(), run)
    assert torch.load(run.checkpoints / "last.ckpt", weights_only=True)["epoch"] == 2
    for name, weight in estimator.net.state_dict().items():
        assert torch.equal(weight, again.net.state_dict()[name]), name


def test_a_model_that_leaves_the_gpu_alone_does_so_when_it_predicts(make_data, monkeypatch):
    estimator, windows = configured("lstm"), make_data().test_windows()  # trainer.accelerator=cpu
    estimator._build(2, 60, 1)
    expected = estimator.predict(windows)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert np.array_equal(estimator.predict(windows), expected)


def test_fold_must_divide_the_window():
    with pytest.raises(InputError, match=r"model\.net\.fold=7"):
        configured("lstm", "model.net.fold=7")._build(2, 60, 1)


def test_the_width_of_a_block_is_odd():
    with pytest.raises(InputError, match=r"model\.net\.width=4: must be odd"):
        configured("tcn", "model.net.width=4")._build(2, 60, 1)


def test_what_a_network_cannot_read_shows_before_there_are_data(make_data):
    data = make_data()
    configured("tcn").check(data)
    with pytest.raises(InputError, match=r"model\.net: .*stride.*; change model\.net"):
        configured("tcn", "model.net.stem_stride=0").check(data)


def test_folding_keeps_every_sample():
    net = net_of("lstm")
    signals = torch.randn(1, 60, 2)
    before = net(signals)
    for step in range(0, 60, 7):
        changed = signals.clone()
        changed[0, step] += 1
        assert not torch.equal(net(changed), before)
