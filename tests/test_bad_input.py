"""Wrong input: exit code 2, one line that names value, range and key, and nothing half-written."""

import json
import os
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import xgboost
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from clearance.commands import CONFIGURATION
from clearance.recording.dataset import Dataset
from clearance.recording.files import write
from clearance.recording.recording import Recording
from tests.command_line import SMALL, TREES, call

SHORT = ("runs=1", "campaign.duration=0.3", "campaign.record_start=0.1")


@pytest.fixture(scope="module")
def campaign():
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return instantiate(compose("simulate", ["seed=9", *SHORT]).campaign, _convert_="all")


@pytest.fixture(scope="module")
def recording(campaign):
    return campaign.recording(0)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("rnus=3", "Could not override 'rnus': there is no such key; did you mean 'runs'"),
        ("mechanism.rod.lenght=1", "no such key; did you mean 'length'.*--cfg job shows all keys$"),
        (
            "mechanism.guide_offset=abc",
            "guide_offset = 'abc' is not a number; change mechanism.guide_offset$",
        ),
        ("++seeed=7", r"\+\+seeed=7: \+ adds keys inside others"),
        ("contact.hardness=1", r"contact has restitution, .* is given as \+contact.hardness=1; --cfg"),
        ("runs=1,2", r"runs=1,2: several values are a sweep, which needs -m; a list is 'runs=\[1,2\]'$"),
        ("joint=B,C", "joint=B,C: several values are a sweep, which needs -m$"),
        ("joint=[B,C]", r"joint=\[B,C\]: one option is chosen, not a list; one run for each: -m joint=B,C$"),
        ("mechanism.gravity=[0,-9", r"^error: mechanism.gravity=\[0,-9: .*must be closed$"),
        ("runs", "'runs'.*; write KEY=VALUE$"),
        ("mechanism=press", "mechanism/press.*; a machine of your own is a file, mechanism=FILE.yaml$"),
        ("mechanism.rod.length=120", r"length = 120 is outside \(0, 10\]; change mechanism.rod.length$"),
        ("contact=flroes", "contact/flroes.*flores hunt_crossley"),
        ("runs=0", r"runs = 0 is outside \[1, .*change runs$"),
        ("runs=2.5", "runs = 2.5 is not a whole number; change runs$"),
        ("runs=1e1", "runs = 10.0 is not a whole number; change runs$"),
        ("runs=many", "runs = 'many' is not a number; change runs$"),
        ("seed=-1", r"seed = -1 is outside \[0, .*change seed$"),
        ("workers=-1", "workers = -1.*1 or more, or null; change workers"),
        ("shard=4/3", "shard = 4/3 must be k/n with 1 <= k <= n"),
        ("shard=half", "shard = 'half' must be k/n, for example"),
        ("campaign.clearance_range=[-1e-4,1e-3]", r"-0.0001 is outside \[0, 0.002\]; change campaign.cl"),
        ("campaign.clearance_range=[0,1]", r"= 1 is outside \[0, 0.002\]; change campaign.clearance_range"),
        ("campaign.clearance_range=[1e-3,0]", "change campaign.clearance_range"),
        ("campaign.speed_range=600", "= 600 is not a list of 2 numbers; change campaign.speed_range"),
        ("mechanism.joint_c.clearance=5e-3", r"0.005 is outside \[0, 0.002\]; change mechanism.joint_c"),
        ("mechanism.joint_b.clearance=-1e-5", r"-1e-05 is outside .*; change mechanism.joint_b.clearance"),
        ("mechanism.rod.length=0.05", r"rod.length = 0.05 m.*exceed.*0.05 m; change mechanism.rod.length"),
        ("mechanism.guide_offset=0.08", "cannot turn.*guide_offset"),
        ("mechanism.crank.mass=-1", r"mass = -1 is outside \(0, inf\); change mechanism.crank.mass"),
        ("mechanism.crank=0.08", r"crank = 0.08 is no Link; give \{mass: .*change .*mechanism.crank$"),
        ("mechanism.joint_c=null", r"joint_c = None is no Joint; give \{clearance: .*mechanism.joint_c$"),
        ("mechanism.guide=loose", r"guide = 'loose' is no guide law; write guide=loose on the .*nism.guide$"),
        ("mechanism.drive=null", "drive = None is no drive law; write drive=NAME .*change mechanism.drive$"),
        (
            "mechanism.link={_target_: clearance.mechanism.guide.LooseGuide}",
            "link = LooseGuide is no link law; write link=NAME",
        ),
        ("mechanism.joint_c.friction=abc", "friction = 'abc' is no friction law; .*mechanism.joint_c.fric"),
        ("mechanism.joint_b.friction=${film}", "friction = Dry is no friction law"),
        ("mechanism.joint_b.contact=flores", "'flores' is no ContactLaw; write contact=flores on the comma"),
        (("bearing=worn", "bearing.order=2.5"), "order = 2.5 is not a whole number of lobes; change bear"),
        (
            ("bearing=worn", "mechanism.joint_b.clearance=1e-5"),
            r"amplitude = 2e-05 m closes the bore of a joint .*1e-05 m .*change mechanism.joint_b.clear",
        ),
        (
            ("bearing=worn", "campaign.clearance_range=[1e-5,2e-5]"),
            "joint_c: 2e-05 m, must be above 2.2e-05 m, or the lobes .*change campaign.clearance_range$",
        ),
        (
            ("bearing=worn", "joint=none", "campaign.random={joint_b.clearance: [0, 1e-4]}"),
            "clearance of joint_b: 0 m, must be above 2e-05 m, .* change campaign.random$",
        ),
        ("drive=free", "mechanism.drive = Free: nothing turns a run, which begins at rest.*mechanism.drive$"),
        ("campaign.joint=null", "joint = None is no ClearanceLocation; write joint=NAME .*campaign.joint$"),
        ("campaign.chain=null", "chain = None is no MeasurementChain; write chain=NAME .*campaign.chain$"),
        ("campaign.integrator=euler", "'euler' is no Integrator; write integrator=euler on the command li"),
        ("campaign.sensors=mems", "'mems' is no SensorChain; write sensor_chain=NAME .*campaign.sensors$"),
        ("mechanism.gravity=9.81", "gravity = 9.81 is not a list of 2 numbers; change mechanism.gravity"),
        ("contact.restitution=1.5", r"restitution = 1.5 is outside \(0, 1\]; change contact.restitution"),
        ("+contact.hardness=1", "contact.hardness: there is no such key; LankaraniNikravesh takes restit"),
        ("+sensor_chain.rod=1", "sensor_chain.rod: there is no such key; SensorChain takes sensors, default"),
        ("chain.filter_order=3", "filter_order = 3 is odd.*change chain.filter_order"),
        ("chain.decimation=0", r"decimation = 0 is outside \[1, 200\]; change chain.decimation"),
        ("integrator.step=1", r"step = 1 is outside .*; change integrator.step"),
        ("integrator.scheme=verlet", "'verlet' is not one of semi_implicit_euler, runge_kutta_4; change"),
        ("+sensor_chain.default.gian=1", "unknown key gian; did you mean 'gain'"),
        ("campaign.record_start=1", r"record_start = 1 is outside \[0, 0.3\]; change campaign.record_start"),
        ("dataset=/dev/null", "dataset = /dev/null holds something else; give a folder that is new or empty"),
    ],
)  # fmt: skip
def test_simulate(refused, tmp_path, override, words):
    override = (override,) if isinstance(override, str) else override
    refused("simulate", words, *SHORT, "dataset=data", *override)
    assert not (tmp_path / "data").exists()


def test_simulate_with_other_settings_names_them(refused, campaign, tmp_path):
    campaign.generate(tmp_path / "data")
    before = sorted(tmp_path.rglob("*"))
    words = r"data was made with other settings \(integrator.step: 1e-05 there, 5e-06 here\)"
    refused("simulate", words, *SHORT, "seed=9", "dataset=data", "integrator.step=5e-6")
    assert sorted(path for path in tmp_path.rglob("*") if "run" not in path.parts) == before


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("model=lsmt", "model/lsmt.*gru lstm"),
        ("sensors=rob", "sensors/rob.*rod"),
        ("sensors.channels=[rod_axial]", "'rod_axial' is not a channel; did you mean"),
        ("sensors.channels=[]", "no channel is listed"),
        ("sensors=[rod,crank]", r"-m sensors=rod,crank; sensors of your own: 'sensors.channels=\[...\]'$"),
        ("+seeed=1", r"\+seeed=1: \+ adds keys inside others, .* of the command's own is seeed=\.\.\., "),
        ("seed=-1", r"seed = -1 is outside .*; change seed$"),
        ("seeds=3", r"seeds=3: must be a list of different whole numbers from 0 to 4294967295; set seeds"),
        ("seeds=[1,1]", r"seeds=\[1, 1\]: must be a list of different whole numbers"),
        ("seeds=[]", r"seeds=\[\]: must be a list"),
        ("seeds=[1,-2]", r"seeds=\[1, -2\]: must be a list"),
        ("split_seed=x", "seed = 'x' is not a number; change split_seed$"),
        ("trainer.epochs=0", r"epochs = 0 is outside \[1, 1e\+06\]; change trainer.epochs"),
        ("trainer.threads=0", r"threads = 0 is outside \[1, 1024\]; change trainer.threads"),
        ("trainer.schedule.warmup=1", r"warmup = 1 is outside \[0, 0.99\]; change trainer.schedule.warmup$"),
        ("trainer.schedule=null", r"trainer.schedule = null: a training needs one; change trainer.schedule$"),
        (
            "trainer.progress=no",
            "trainer.progress = 'no' is neither true nor false; change trainer.progress$",
        ),
        ("resume=no", "resume = 'no' is neither true nor false; change resume$"),
        ("trainer.schedule.warmup=abc", "warmup = 'abc' is not a number; change trainer.schedule.warmup$"),
        ("+trainer.schedule.end=2", r"end = 2 is outside \[0, 1\]; change trainer.schedule.end$"),
        ("begin=1", "begin=1: no finished training there"),
        ("trainer.optimizer.lr=-1", "Invalid learning rate: -1; change trainer.optimizer"),
        ("trainer.optimizer.lr=high", "lr = 'high' is not a number; change trainer.optimizer.lr$"),
        ("trainer.monitor=val/mae", "trainer.monitor=val/mae: must be one of val/loss"),
        ("model.net.fold=7", "model.net.fold=7: must divide the window of 200 samples; set model.net.fold"),
        ("model.net.layers=0", "model.net: num_layers must be greater than zero; change model.net$"),
        ("model.gradient_clip=0", r"gradient_clip = 0 is outside \(0, inf\); change model.gradient_clip"),
        ("windows.length=0", r"length = 0 is outside \[1, inf\); change windows.length"),
        ("windows.stride=x", "stride = 'x' is not a number; change windows.stride"),
        ("data.batch_size=0", r"batch_size = 0 is outside \[1, inf\); change data.batch_size"),
        ("data.memory_gib=0", r"memory_gib = 0 is outside .*; change data.memory_gib"),
        ("data.split.train=0.9", "their sum below 1; set data.split.train"),
        ("clearance_range=0", r"= 0 is outside \(0, 1\]; change clearance_range"),
        ("calibration.coverage=2", r"coverage = 2 is outside \[0.01, 0.999\]"),
        (
            "trainer.precision=64-true",
            "trainer.precision=64-true: must be one of 32-true, .*; set trainer.prec",
        ),
        ("trainer.accelerator=abacus", "change trainer.accelerator, devices or precision"),
        (("data=streaming", "split_seed=3"), "split_seed: nothing is divided.*set data.source.held_out"),
        (
            ("data=stored", "data.source.path=a", "sensor_chain=mems"),
            "sensor_chain: of simulated runs, of which these data have none; leave it out$",
        ),
        ("data=stored", "Missing mandatory value: data.source.path is not given; write data"),
        (
            ("data=stored", "data.source.path=a", "runs=9"),
            "runs=9: a number of simulated runs.*data.source.r",
        ),
        (("data=measured", "data.source.path=a", "runs=9"), "runs=9: a number of simulated runs"),
        (
            ("data=measured", "data.source.path=a", "start_time=2.0"),
            "start_time=2.0: of stored and simulated",
        ),
        ("+calibration.share=0.9", "calibration"),
        (
            ("data=stored", "data.source.path=a", "data.source.runs=abc"),
            "'abc' is not a number.*source.runs$",
        ),
        (("data=stored", "data.source.path=a", "data.source.runs=0"), "0 is outside .*data.source.runs$"),
        (("data=stored", "data.source.path=a", "start_time=abc"), "start_time = 'abc' is not a number"),
        (
            ("data=streaming", "data.source.runs=1e3"),
            "1000.0 is not a whole number; change data.source.runs$",
        ),
        (("data=streaming", "data.source.held_out=0"), "held_out = 0 is outside .*data.source.held_out$"),
        ("data.source.start_time=abc", "start_time = 'abc' is not a number; change data.source.start_time$"),
    ],
)
def test_train_refuses_before_it_simulates_or_writes(refused, tmp_path, override, words):
    override = (override,) if isinstance(override, str) else override
    refused("train", words, *SMALL, "folder=run/training", *override)
    assert not (tmp_path / "outputs").exists()
    assert not (tmp_path / "run/training").exists()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (("data=stored", "data.source.path=nothing"), "nothing is not there; make it with"),
        (("data=measured", "data.source.path=mm.csv"), r"clearance_c=0.3: must be 0 ... 0.02 m .not mm."),
        (("data=stored", "data.source.path=2024"), "2024 is not there; make it with"),
        (("data=measured", "data.source.path=2024"), "2024: not a readable list"),
        (("data=stored", "data.source.path=foreign"), "foreign is not a data set of this project"),
        (("data=stored", "data.source.path=data"), "run 1 is damaged.*signals/c/1/0/0 and repeat"),
        (("data=measured", "data.source.path=nothing.yaml"), "nothing.yaml: not a readable list"),
        (("data=measured", "data.source.path=list.csv"), "run.parquet has no number clearance_c"),
        (("data=simulated", "runs=3"), "two different values are needed; train on more recordings .runs"),
        (("data=simulated", "runs=2"), "2 independent recordings: at least 3 are needed"),
        (("data=simulated", "windows.length=5000"), "2000 samples: at least 5000 are needed.*windows.length"),
        (("data=simulated", "start_time=5"), r"record_start = 5 is outside \[0, 0.3\]; change start_time"),
    ],
)  # fmt: skip
def test_train_names_what_is_wrong_with_its_data(refused, campaign, recording, tmp_path, data, words):
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/zarr.json").write_text('{"zarr_format": 3, "node_type": "group"}')
    replace(campaign, runs=4).generate(tmp_path / "data")
    chunk = tmp_path / "data/signals/c/1/0/0"
    chunk.write_bytes(chunk.read_bytes()[:-100])
    write(recording, tmp_path / "run.parquet")
    (tmp_path / "list.csv").write_text("path,clearance_b\nrun.parquet,1e-4\n")
    (tmp_path / "mm.csv").write_text("path,clearance_c\nrun.parquet,0.3\n")
    refused("train", words, *TREES, *data)
    assert not (tmp_path / "run/metrics.json").exists()


@pytest.mark.skipif(xgboost.build_info()["USE_CUDA"], reason="this XGBoost computes on GPUs")
def test_trees_are_not_grown_on_a_gpu_that_the_library_does_not_know(refused):
    refused("train", "model.device=cuda: this XGBoost .*; set model.device=cpu", *TREES, "model.device=cuda")


def test_a_forest_without_a_job_is_refused(refused):
    words = "model.jobs = 0: must be -1 .all cores. or 1 ... 1024; set model.jobs"
    refused("train", words, "experiment=smoke", "model=random_forest", "model.jobs=0")


def test_trees_are_not_trained_together(refused, tmp_path):
    refused("train", "networks are trained together, and GradientBoosting is none", *TREES, "seeds=[1,2]")
    assert not (tmp_path / "run/seed=1").exists()


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda run: shutil.rmtree(run), "run: no configuration of a model there; set checkpoint"),
        (lambda run: cut(run / "model.ubj"), "model.ubj: not an XGBoost model.*set checkpoint"),
        (lambda run: (run / "model.ubj").unlink(), "model.ubj: not an XGBoost model.*No such file"),
        (lambda run: cut(run / "calibration.json"), "calibration.json: not a readable file of a run"),
        (lambda run: (run / "scalers.json").write_text("[]"), "not the calibration of a training"),
        (lambda run: (run / "scalers.json").write_text("\\0"), "scalers.json: not a readable file"),
        (lambda run: (run / "config.yaml").write_bytes(b"\xff\xfe"), "config.yaml: not a readable config"),
        (
            lambda run: (run / "config.yaml").write_text("model: {_target_: os.system, command: ls}"),
            "names 'os.system'.*set checkpoint",
        ),
    ],
)  # fmt: skip
def test_predict_refuses_a_damaged_or_foreign_checkpoint(
    refused, trained, recording, tmp_path, damage, words
):
    shutil.copytree(trained / "run", tmp_path / "model/run")
    damage(tmp_path / "model/run")
    write(recording, tmp_path / "a.parquet")
    refused("predict", words, "checkpoint=model/run", "recordings=[a.parquet]", "output=p.json")
    assert not (tmp_path / "p.json").exists()


ROD = ("rod_b_transverse", "rod_b_axial", "rod_c_transverse", "rod_c_axial")


def csv(path, recording, time=None, names=ROD):
    time = recording.time if time is None else time
    rows = np.column_stack([time, recording.select(ROD).values[: len(time)]])
    np.savetxt(path, rows, "%.7g", ",", header=",".join(("time", *names)), comments="")


def with_nan(path, recording):
    csv(path, recording)
    lines = path.read_text().splitlines()
    lines[31] = lines[31].replace(lines[31].split(",")[2], "nan")
    path.write_text("\n".join(lines))


@pytest.mark.parametrize(
    ("name", "make", "words"),
    [
        ("a.csv", lambda p, r: csv(p, r, names=("velocity", *ROD[1:])), "a.csv: columns velocity are no cha"),
        (
            "a.csv",
            lambda p, r: (csv(p, r), p.with_suffix(".yaml").write_text("units: {rod_b_axial: furlong}")),
            "a.yaml: units.rod_b_axial: 'furlong' is not a known unit; .* choose from m/s",
        ),
        (
            "a.parquet",
            lambda p, r: write(r.select(("slider_horizontal",)), p),
            "a.parquet: lacks the channels .*rod_b_transverse.*train with sensors that are there",
        ),
        (
            "a.csv",
            lambda p, r: (
                csv(p, r),
                p.with_suffix(".yaml").write_text(
                    "sensors: {rod_b_axial: {mounting_angle: 45}, rod_b_transverse: {mounting_angle: -45}}"
                ),
            ),
            "a.csv: sensors: mounting_angle = .* leave both along one direction",
        ),
        ("a.csv", with_nan, "a.csv: channel 'rod_b_axial' has 1 values that are not finite.*in sample 30"),
        (
            "a.csv",
            lambda p, r: csv(p, r, np.r_[r.time[:1000], r.time[1000:] + 0.01]),
            "a.csv: time jumps by 0.0101 s .*1 such gaps; cut the recording",
        ),
        (
            "a.csv",
            lambda p, r: csv(p, r, np.r_[r.time[:1000], r.time[1000:] + 4e-5]),
            "a.csv: time is not uniform.*resample",
        ),
        (
            "a.parquet",
            lambda p, r: write(Recording(r.values[:150], r.channels, r.rate), p),
            r"a.parquet: 150 samples: at least 200 are needed \(0.02 s\)",
        ),
        (
            "a.parquet",
            lambda p, r: write(Recording(r.values, r.channels, 2e4), p),
            "a.parquet: sampled at 20000 Hz: the model reads 10000 Hz .*resample.*: chain.decimation",
        ),
        ("a.parquet", lambda p, r: (write(r, p), cut(p)), "a.parquet: not readable as Parquet"),
        ("a.parquet", lambda p, r: p.write_bytes(b"foreign" * 99), "a.parquet: not readable as Parquet"),
        ("a.parquet", lambda p, r: None, "a.parquet: there is no such file"),
        ("a.txt", lambda p, r: p.write_text("1 2 3"), "the ending '.txt' is not known; .* end in .parquet"),
    ],
)  # fmt: skip
def test_predict_refuses_a_bad_recording_and_names_it(
    refused, trained, recording, tmp_path, name, make, words
):
    make(tmp_path / name, recording)
    write(recording, tmp_path / "good.parquet")
    refused(
        "predict",
        words,
        f"checkpoint={trained / 'run'}",
        f"recordings=[good.parquet,{name}]",
        "output=p.json",
    )
    assert not (tmp_path / "p.json").exists()


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("recordings=[]", r"recordings=\[\]: at least one file"),
        ("recordings=folder", "recordings: no recording in the folder folder; recordings end in .parquet"),
        ("output=folder", "output=folder: is a folder; set output to a file in it"),
        ("checkpoint=nowhere", "checkpoint=nowhere: no configuration of a model there"),
        ("output=/dev/full/p.json", "/dev/full"),
    ],
)
def test_predict_names_wrong_arguments(refused, trained, recording, tmp_path, override, words):
    write(recording, tmp_path / "good.parquet")
    (tmp_path / "folder").mkdir()
    refused("predict", words, f"checkpoint={trained / 'run'}", "recordings=good.parquet", override)


def test_a_training_that_is_not_there_is_missed_before_results_are_written(refused, trained, tmp_path):
    refused("evaluate", "set picture$", f"runs={trained}", "results=results", "picture=nowhere")
    assert not (tmp_path / "results").exists()


def test_a_report_and_results_are_not_made_at_once(refused, trained, tmp_path):
    words = "report=R.md and results=results: one at a time"
    refused("evaluate", words, f"runs={trained}", "results=results", "report=R.md")
    assert [path for path in tmp_path.iterdir() if path.name in ("R.md", "results")] == []


def test_predict_distrusts_another_measurement_chain(trained, recording, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    other = {**recording.metadata["chain"], "base_rate": 5e4, "decimation": 5}
    for name, metadata in (("same", recording.metadata), ("other", {"chain": other}), ("silent", {})):
        write(
            Recording(recording.values, recording.channels, recording.rate, metadata=metadata),
            tmp_path / f"{name}.parquet",
        )
    csv(tmp_path / "declared.csv", recording)
    (tmp_path / "declared.yaml").write_text("chain: {ripple_db: 0.5}")
    files = "recordings=[same.parquet,other.parquet,silent.parquet,declared.csv]"
    assert (
        call(monkeypatch, capfd, "predict", f"checkpoint={trained / 'run'}", files, "output=p.json")[0] == 0
    )
    same, changed, silent, declared = json.loads((tmp_path / "p.json").read_text())
    assert "chain" not in same["reason"] + silent["reason"]
    assert not changed["trusted"]
    assert "recorded with chain.base_rate = 50000.0, the model was trained with 100000.0" in changed["reason"]
    assert "recorded with chain.decimation = 5, the model was trained with 10" in changed["reason"]
    assert not declared["trusted"]
    assert declared["reason"].startswith(
        "recorded with chain.ripple_db = 0.5, the model was trained with 0.05"
    )


def test_predict_distrusts_a_sensor_elsewhere_than_in_training(
    trained, recording, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    for name, place in (("joint", 0.12), ("elsewhere", 0.02)):
        write(recording, tmp_path / f"{name}.parquet")
        (tmp_path / f"{name}.yaml").write_text(f"sensors: {{rod_c_axial: {{position: {place}}}}}")
    files = ("recordings=[joint.parquet,elsewhere.parquet]", "output=p.json")
    assert call(monkeypatch, capfd, "predict", f"checkpoint={trained / 'run'}", *files)[0] == 0
    joint, elsewhere = json.loads((tmp_path / "p.json").read_text())
    assert "sensor" not in joint["reason"]
    assert not elsewhere["trusted"]
    assert elsewhere["reason"].startswith("sensor rod_c_axial is at 0.02 m, the model was trained with 0.12")


@pytest.fixture
def small_disk(tmp_path):
    """A file system of its own that holds 300 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("file systems cannot be mounted here")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_simulate_on_a_full_disk_says_so_and_goes_on_when_there_is_room(refused, campaign, small_disk):
    many = ("runs=12", *SHORT[1:], "seed=9", "workers=1")  # of 80 kB each
    refused("simulate", "No space left on device; make room", *many, f"dataset={small_disk / 'data'}")
    stored = Dataset.open(small_disk / "data")
    assert 0 < len(stored.available()) < 12
    for run in stored.available():
        stored.read(int(run))
    assert not list(small_disk.rglob("*.partial"))
    subprocess.run(["mount", "-o", "remount,size=5m", str(small_disk)], check=True)
    whole = replace(campaign, runs=12)
    resumed, elsewhere = whole.generate(small_disk / "data"), whole.generate(small_disk / "other")
    for run in range(12):
        np.testing.assert_array_equal(resumed.read(run), elsewhere.read(run))


def test_train_on_a_full_disk_says_so(refused, small_disk):
    (small_disk / "filler").write_bytes(bytes(4096 * (os.statvfs(small_disk).f_bavail - 3)))
    refused("train", "No space left.*", *TREES, f"folder={small_disk / 'training'}")
    assert not (small_disk / "training/metrics.json").exists()
