from copy import deepcopy
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from clearance.errors import InputError
from clearance.models.together import SparingCheckpoint, fit_together, shareable
from clearance.whole_files import write_json
from clearance.windows.windowing import RandomWindows
from tests.models.conftest import NEURAL, configured

SEEDS = (42, 43, 44)
# A rate at which the error goes up and down, and no patience: each seed stops at an epoch of its own.
STOPPING = ("trainer.epochs=5", "trainer.patience=1", "trainer.optimizer.lr=3e-2")


made = cache(configured)  # composing takes longer than training


class Killed(Exception):
    pass


@pytest.fixture
def train(make_data, open_run):
    """Train the seeds together; give the estimators, the runs and the seconds."""

    def run(model, *overrides, name="together", data=None):
        estimators = [deepcopy(made(model, *overrides)) for _ in SEEDS]
        runs = [open_run(f"{name}-{seed}", seed) for seed in SEEDS]
        seconds = fit_together(estimators, data or make_data(), runs, open_run(name))
        return estimators, runs, seconds

    return run


@pytest.fixture
def train_apart(make_data, open_run):
    """Train one seed as without the others."""

    def run(model, seed, *overrides, data=None):
        estimator, run = deepcopy(made(model, *overrides)), open_run(f"apart-{seed}", seed)
        estimator.fit((data or make_data()).reseeded(seed), run)
        return estimator, run

    return run


def events(run):
    """Steps and values of every tag, without those of time."""
    run.logger.save()
    found = {}
    # Files of one second are numbered, and TensorBoard reads a tenth before a ninth.
    for file in sorted(run.path.glob("*.tfevents.*"), key=lambda path: int(path.name.rsplit(".", 1)[1])):
        read = EventAccumulator(str(file)).Reload()
        for tag in read.Tags()["scalars"]:
            found.setdefault(tag, []).extend((one.step, one.value) for one in read.Scalars(tag))
    return found


def assert_same(together, apart):
    for name, weight in apart.net.state_dict().items():
        # Single precision rounds to 6e-8; Adam's first steps make a sign of a gradient that is all rounding.
        torch.testing.assert_close(together.net.state_dict()[name], weight, rtol=1e-4, atol=2e-6, msg=name)


@pytest.mark.parametrize("model", NEURAL)
def test_trained_together_or_apart_the_weights_and_the_events_are_the_same(
    model, train, train_apart, make_data
):
    data = make_data(targets=("clearance_b", "clearance_c"))
    estimators, runs, seconds = train(model, "trainer.epochs=3", data=data)
    for seed, estimator, run in zip(SEEDS, estimators, runs, strict=True):
        apart, own = train_apart(model, seed, "trainer.epochs=3", data=data)
        assert_same(estimator, apart)
        assert estimator.parameters == apart.parameters
        ours, theirs = events(run), events(own)
        assert ours.keys() == theirs.keys()
        for tag, values in theirs.items():
            np.testing.assert_allclose(ours[tag], values, rtol=1e-4, err_msg=tag)
    assert all(second > 0 for second in seconds)
    one, other = (next(iter(estimator.net.state_dict().values())) for estimator in estimators[:2])
    assert not torch.equal(one, other)


def test_one_may_stop_before_the_others(train, train_apart):
    estimators, runs, _ = train("tcn", *STOPPING)
    lengths = []
    for seed, estimator, run in zip(SEEDS, estimators, runs, strict=True):
        apart, own = train_apart("tcn", seed, *STOPPING)
        lengths.append(len(events(own)["val/loss"]))
        assert len(events(run)["val/loss"]) == lengths[-1]
        assert_same(estimator, apart)
    assert len(set(lengths)) == 3


@pytest.mark.parametrize("epoch", [1, 3])
def test_a_killed_stack_goes_on_to_the_same_weights(epoch, train, make_data, monkeypatch):
    whole, runs, _ = train("tcn", *STOPPING, name="whole")
    interrupted = make_data()
    place = interrupted.reseeded

    def killed_at(windows, now):
        if now == epoch:
            raise Killed
        return windows

    def reseeded(seed):
        other = place(seed)
        cut = other.training_windows
        monkeypatch.setattr(other, "training_windows", lambda now: killed_at(cut(now), now))
        return other

    monkeypatch.setattr(interrupted, "reseeded", reseeded)
    with pytest.raises(Killed):
        train("tcn", *STOPPING, name="killed", data=interrupted)
    resumed, again, _ = train("tcn", *STOPPING, name="killed")
    for one, other, run, rerun in zip(whole, resumed, runs, again, strict=True):
        assert events(run)["val/loss"] == events(rerun)["val/loss"]
        for name, weight in one.net.state_dict().items():
            assert torch.equal(weight, other.net.state_dict()[name]), name


def test_what_is_trained_to_the_end_is_not_trained_on(train):
    settings = ("trainer.epochs=9", "trainer.patience=1", "trainer.optimizer.lr=0")
    first, runs, seconds = train("tcn", *settings)
    again, _, later = train("tcn", *settings)
    assert later == seconds
    assert len(events(runs[0])["val/loss"]) == 2
    for one, other in zip(first, again, strict=True):
        for name, weight in one.net.state_dict().items():
            assert torch.equal(weight, other.net.state_dict()[name]), name


def test_windows_at_random_places_are_each_seed_s_own(train, train_apart, make_data):
    data = make_data()
    data.windows = RandomWindows(60)
    estimators, _, _ = train("tcn", data=data)
    for seed, estimator in zip(SEEDS, estimators, strict=True):
        assert_same(estimator, train_apart("tcn", seed, data=data)[0])


def test_a_network_whose_loss_is_not_finite_stops_alone(train, make_data, monkeypatch):
    data = make_data()
    place = data.reseeded

    def reseeded(seed):
        other = place(seed)
        cut = other.training_windows

        def spoilt(now):
            windows = cut(now)
            if seed == 43:
                windows.target.fill_(float("nan"))
            return windows

        monkeypatch.setattr(other, "training_windows", spoilt)
        return other

    monkeypatch.setattr(data, "reseeded", reseeded)
    estimators, runs, _ = train(
        "lstm", "trainer.epochs=3", "trainer.loss._target_=torch.nn.MSELoss", data=data
    )
    assert [len(events(run)["val/loss"]) for run in runs] == [3, 1, 3]
    finite = [all(w.isfinite().all() for w in estimator.net.parameters()) for estimator in estimators]
    assert finite == [True, False, True]


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("trainer.optimizer._target_=torch.optim.LBFGS", r"trainer\.optimizer=LBFGS"),
        ("trainer.precision=bf16-mixed", r"trainer\.precision=bf16-mixed: must be 32-true or 32 for"),
    ],
)
def test_what_cannot_be_shared_is_refused(override, words):
    drop = ["~trainer.optimizer.weight_decay"] if "LBFGS" in override else []
    with pytest.raises(InputError, match=words):
        shareable([configured("tcn", override, *drop)])


@pytest.mark.parametrize("precision", ["32", "32-true"])
def test_single_precision_can_be_shared_whatever_it_is_called(precision):
    assert len(shareable([configured("tcn", f"trainer.precision={precision}")])) == 1


def test_a_checkpoint_that_takes_long_is_written_seldom_and_at_the_end(tmp_path, monkeypatch):
    now = iter([0.0, 3.0, 30.0, 61.0, 64.0, 70.0, 73.0])  # s; writing takes three
    monkeypatch.setattr("clearance.models.together.time.perf_counter", lambda: next(now))
    trainer, saved = SimpleNamespace(should_stop=False, max_epochs=4), []
    trainer.save_checkpoint = lambda path: saved.append(trainer.current_epoch)
    newest = SparingCheckpoint(tmp_path / "last.ckpt")
    for trainer.current_epoch in range(4):
        newest.on_train_epoch_end(trainer, None)
    assert saved == [0, 2, 3]


def test_events_of_a_seed_that_is_finished_stay(train, open_run):
    run = open_run("together-43", 43)
    write_json(run.path / "metrics.json", {})
    _, runs, _ = train("tcn")
    assert [run.path / "metrics.json" for run in runs if run.finished] == [run.path / "metrics.json"]
    assert [bool(list(run.path.glob("events*"))) for run in runs] == [True, False, True]


def test_each_gradient_is_clipped_by_its_own_norm(train, train_apart):
    # Plain descent: Adam would hide a gradient's length.
    settings = ("trainer.optimizer._target_=torch.optim.SGD", "trainer.optimizer.lr=1", "trainer.epochs=2")
    clipped = (*settings, "model.gradient_clip=0.02")
    estimators, _, _ = train("lstm", *clipped)
    for seed, estimator in zip(SEEDS, estimators, strict=True):
        assert_same(estimator, train_apart("lstm", seed, *clipped)[0])
    free, _, _ = train("lstm", *settings, name="free")
    for one, other in zip(estimators, free, strict=True):
        assert (one.net.output.weight - other.net.output.weight).abs().max() > 1e-2


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("model", ["lstm", "gru", "tcn"])
def test_on_a_gpu_too_and_after_one_has_stopped(model, train, train_apart):
    # Recorded passes of whole batches, the epoch's last smaller one, and anew when a seed is taken out.
    settings = (*STOPPING, "trainer.optimizer.lr=3e-3", "trainer.accelerator=gpu")
    estimators, runs, _ = train(model, *settings)
    for seed, estimator, run in zip(SEEDS, estimators, runs, strict=True):
        apart, own = train_apart(model, seed, *settings)
        first, theirs = events(run)["val/loss"][0], events(own)["val/loss"][0]
        np.testing.assert_allclose(first, theirs, rtol=1e-2)  # ten bits of a product (TF32)
        assert estimator.parameters == apart.parameters
