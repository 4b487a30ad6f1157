"""Sweeps as a user types them: a folder a job, failures that stop nothing, launchers, tuning, TensorBoard."""

import json
import shlex
import subprocess

import pytest
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf
from tensorboard.backend.event_processing.data_provider import MultiplexerDataProvider
from tensorboard.backend.event_processing.plugin_event_multiplexer import EventMultiplexer
from tensorboard.context import RequestContext
from tensorboard.plugins.base_plugin import TBContext
from tensorboard.plugins.hparams.api_pb2 import ListSessionGroupsRequest
from tensorboard.plugins.hparams.backend_context import Context
from tensorboard.plugins.hparams.list_session_groups import Handler

from tests.command_line import ROOT, SMALL, launch

BRIEF = (*SMALL, "trainer.epochs=1")
PRINTED = "python -m clearance.train -m model=lstm,gru sensors=rod,crank joint=B,C 'seed=range(3)'"


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    return tmp_path_factory.mktemp("sweeps")


@pytest.fixture(scope="module")
def swept(home):
    """Three trainings, of which the first cannot be."""
    return launch("train", "-m", *BRIEF, "seed=range(-1,2)", folder=home)


def folders(home, **overrides):
    jobs = home / "outputs/train/smoke"
    return {path for path in jobs.iterdir() if all(f"{k}={v}" in path.name for k, v in overrides.items())}


def test_the_sweep_that_is_printed_reaches_the_command_as_24_jobs():
    assert f"\n{PRINTED} " in (ROOT / "README.md").read_text()
    shell = subprocess.run(
        ["bash", "-c", f"printf '%s\\n' {PRINTED}"], capture_output=True, text=True, check=True
    )
    _, _, _, _, *overrides = shell.stdout.splitlines()
    parsed = OverridesParser.create().parse_overrides(overrides)
    (jobs,) = BasicSweeper.split_arguments(parsed, None)
    assert len({tuple(job) for job in jobs}) == 2 * 2 * 2 * 3
    assert ["model=gru", "sensors=crank", "joint=C", "seed=2"] in jobs


def test_a_job_that_fails_does_not_stop_the_sweep_and_is_listed(swept, home):
    assert swept.returncode == 1
    assert "1 of 3 jobs failed; the same command runs these again:\n" in swept.stderr
    listed = swept.stderr.splitlines()[-1]
    assert listed.startswith("  experiment=smoke ")
    assert "seed=-1: WindowData.seed = -1 is outside [0, " in listed
    for seed in (0, 1):
        (folder,) = folders(home, seed=seed)
        assert (folder / "metrics.json").exists()
        assert folder.name == ",".join(sorted((*SMALL[1:], "trainer.epochs=1", f"seed={seed}")))
    (failed,) = folders(home, seed=-1)
    assert "WindowData.seed = -1 is outside" in (failed / "train.log").read_text()


def test_the_same_sweep_again_repeats_nothing_that_is_finished(swept, home):
    before = {path: path.stat().st_mtime_ns for path in home.rglob("metrics.json")}
    again = launch("train", "-m", *BRIEF, "seed=range(-1,2)", folder=home)
    assert again.returncode == 1
    assert again.stdout.count("is finished: resume=false trains again") == 2
    assert {path: path.stat().st_mtime_ns for path in home.rglob("metrics.json")} == before


def test_tensorboard_compares_the_jobs_side_by_side(swept, home):
    (folder,) = {path.parent for path in folders(home, seed=0)}
    events = EventMultiplexer().AddRunsFromDirectory(str(folder)).Reload()
    provider = MultiplexerDataProvider(events, str(folder))
    context = Context(TBContext(data_provider=provider, logdir=str(folder)))
    request = RequestContext()
    columns = context.experiment_from_metadata(request, "", True, context.hparams_metadata(request, ""), [])
    assert columns.hparam_infos[0].name == "seed"  # in what they differ comes first
    assert "test/nmae" in {info.name.tag for info in columns.metric_infos}
    wanted = ListSessionGroupsRequest(slice_size=10, allowed_statuses=[0, 1, 2, 3])
    wanted.col_params.add().metric.tag = "test/nmae"
    rows = Handler(request, context, "", wanted).run().session_groups
    assert {row.hparams["seed"].number_value for row in rows} == {0, 1}
    for row in rows:
        (job,) = folders(home, seed=int(row.hparams["seed"].number_value))
        shown = {value.name.tag: value.value for value in row.metric_values}
        said = json.loads((job / "metrics.json").read_text())["test"]
        assert shown["test/nmae"] == pytest.approx(said["nmae"], rel=1e-6)
        assert row.hparams["model/net/hidden_size"].number_value == 16


@pytest.mark.slow
def test_joblib_runs_jobs_beside_each_other(swept, home):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    done = launch("train", "-m", *BRIEF, "seed=-1,2", "hydra/launcher=joblib", folder=home)
    assert done.returncode == 1
    assert "1 of 2 jobs failed" in done.stderr
    assert "seed=-1: WindowData.seed = -1 is outside" in done.stderr
    (folder,) = folders(home, seed=2)
    assert (folder / "metrics.json").exists()


@pytest.mark.slow
def test_optuna_tunes_and_goes_on_where_it_was(swept, home):
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    tune = (
        *BRIEF, "hydra/sweeper=optuna", "seed=-1,3",
        "trainer.optimizer.lr=tag(log,interval(1e-4,1e-1))",
    )  # fmt: skip
    first = launch("train", "-m", *tune, "hydra.sweeper.n_trials=3", folder=home)
    assert first.returncode == 0, first.stderr
    tried = folders(home, **{"trainer.optimizer.lr": ""})
    assert len(tried) == 3
    values = [
        json.loads((path / "metrics.json").read_text())["validation"]["nmae"]
        for path in tried
        if (path / "metrics.json").exists()
    ]
    assert first.stdout.count("Failed experiment: WindowData.seed = -1") == 3 - len(values)
    result = OmegaConf.load(home / "outputs/train/optimization_results.yaml")
    assert result.best_value == min(values)
    again = launch("train", "-m", *tune, "hydra.sweeper.n_trials=3", folder=home)
    assert again.stdout.count("is finished: resume=false trains again") == len(values)
    assert folders(home, **{"trainer.optimizer.lr": ""}) == tried


def test_a_plugin_that_is_not_installed_is_one_line(home):
    done = launch("train", "-m", *BRIEF, "hydra/launcher=ray", folder=home)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "Could not find 'hydra/launcher/ray'" in done.stderr
    assert shlex.quote(".[sweeps]") in done.stderr
