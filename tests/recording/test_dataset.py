"""Data sets survive kills, damage and strangers."""

import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.mechanism.bearing import Worn
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.provenance import simulator
from clearance.recording import dataset as stored
from clearance.recording import synthesis
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.dataset import Dataset
from clearance.recording.sensors import SensorChain
from clearance.recording.synthesis import Campaign, ClearanceLocation
from clearance.simulation.integrator import Integrator

SMALL = Campaign(
    SliderCrank(), ClearanceLocation("C", False, True), Integrator(), MeasurementChain(), SensorChain(),
    runs=20, seed=5, duration=0.25, record_start=0.2,
)  # fmt: skip


def contents(dataset):
    return np.stack([dataset.read(run) for run in dataset.available()])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return SMALL.generate(tmp_path_factory.mktemp("whole") / "data")


def test_a_data_set_holds_what_was_asked(whole):
    assert whole.available().tolist() == list(range(20))
    assert (whole.rate, whole.start_time, whole.samples) == (1e4, 0.2, 500)
    assert whole.read(3, ("rod_c_axial",)).shape == (500, 1)
    labels = whole.labels
    assert np.all((labels["clearance_c"] > 0) & (labels["clearance_c"] < 1e-3))
    assert np.all(labels["clearance_b"] == 0)
    assert np.all((labels["speed"] > 500 * np.pi / 30) & (labels["speed"] < 1000 * np.pi / 30))


def test_shards_fill_the_same_data_set_bit_for_bit(whole, tmp_path):
    for part in (2, 1, 3):
        sharded = SMALL.generate(tmp_path / "data", (part, 3), workers=1)
    np.testing.assert_array_equal(contents(sharded), contents(whole))


def test_a_larger_campaign_goes_on_with_the_same_runs(whole, tmp_path):
    replace(SMALL, runs=7).generate(tmp_path / "data")
    grown = SMALL.generate(tmp_path / "data")
    np.testing.assert_array_equal(contents(grown), contents(whole))
    np.testing.assert_array_equal(grown.labels["clearance_c"], whole.labels["clearance_c"])


def test_of_two_that_grow_a_data_set_at_once_the_larger_one_wins(tmp_path, monkeypatch):
    replace(SMALL, runs=3).generate(tmp_path / "data")
    plain, inside = Dataset._grow, []

    def slow(dataset, labels):
        if not inside:  # the smaller one waits here for the larger one, which must wait for it in turn
            inside.append(len(labels))
            larger = threading.Thread(target=SMALL.generate, args=(tmp_path / "data",))
            larger.start()
            larger.join(timeout=0.5)
            assert larger.is_alive()
            waiting.append(larger)
        plain(dataset, labels)

    waiting = []
    monkeypatch.setattr(Dataset, "_grow", slow)
    replace(SMALL, runs=6).generate(tmp_path / "data")
    waiting[0].join()
    assert len(inside) == 1
    grown = Dataset.open(tmp_path / "data")
    assert grown.runs == 20
    assert len(grown.missing()) == 0
    np.testing.assert_array_equal(grown.labels["speed"], SMALL.labels(range(20))[:, 2])


def test_physics_that_nobody_knows_is_drawn_for_each_run(whole):
    limits = {"gravity.1": (-9.81, 0.0), "joint_b.clearance": (0.0, 3e-4)}
    drawn = replace(SMALL, random=limits)
    machines = [drawn.machine(run) for run in range(20)]
    for name, values in {
        "gravity.1": [m.gravity[1] for m in machines],
        "joint_b.clearance": [m.joint_b.clearance for m in machines],
    }.items():
        low, high = limits[name]
        assert low <= min(values) < low + 0.3 * (high - low) < high - 0.3 * (high - low) < max(values) <= high
    assert drawn.machine(4) == machines[4]
    np.testing.assert_array_equal(drawn.labels(range(20))[:, 0], [m.joint_b.clearance for m in machines])
    assert [m.joint_c.clearance for m in machines] == whole.labels["clearance_c"].tolist()
    some = [replace(drawn, random_share=0.3).machine(run).gravity[1] for run in range(200)]
    assert 0.6 < some.count(0.0) / 200 < 0.8
    assert drawn.fingerprint != SMALL.fingerprint == replace(SMALL, random={}).fingerprint


def test_where_the_clearance_is_may_be_left_to_chance(whole, tmp_path):
    unknown = replace(SMALL, joint=ClearanceLocation("unknown", None, None))
    labels = unknown.labels(range(400))
    at_b, at_c = labels[:, 0] > 0, labels[:, 1] > 0
    shares = [np.mean((at_b == b) & (at_c == c)) for b in (False, True) for c in (False, True)]
    assert shares == pytest.approx([0.25] * 4, abs=0.09)  # four deviations of a binomial share
    # All else is drawn as where the joint is known: a clearance that is there is the one it would have been.
    known = {
        b: replace(SMALL, joint=ClearanceLocation("", b, not b)).labels(range(400)) for b in (True, False)
    }
    np.testing.assert_array_equal(labels[at_b, 0], known[True][at_b, 0])
    np.testing.assert_array_equal(labels[at_c, 1], known[False][at_c, 1])
    np.testing.assert_array_equal(labels[:, 2], known[True][:, 2])
    np.testing.assert_array_equal(unknown.labels([7, 3]), labels[[7, 3]])
    for part in (2, 1):
        sharded = replace(unknown, runs=6).generate(tmp_path / "data", (part, 2), workers=1)
    first = contents(sharded)
    larger = replace(unknown, runs=8).generate(tmp_path / "data")
    np.testing.assert_array_equal(contents(larger)[:6], first)
    np.testing.assert_array_equal(larger.labels["clearance_b"], labels[:8, 0])
    alone = next(run for run in range(8) if at_c[run] and not at_b[run])
    np.testing.assert_array_equal(larger.read(alone), whole.read(alone))
    worn = replace(SliderCrank(), joint_b=Joint(3e-4))
    own = replace(unknown, mechanism=worn).labels(range(400))
    assert set(own[~at_b, 0]) == {3e-4}


def test_a_data_set_of_an_earlier_version_is_found_again():
    # What names its folder: the setting of every draw, and no more than was there.
    assert SMALL.fingerprint == "529d488aefd2125a"
    assert "random" not in SMALL.settings


def test_a_whole_number_makes_no_other_data_set(tmp_path):
    floats = replace(SMALL, runs=1, duration=1.0, record_start=0.0, speed_range=(500.0, 1000.0))
    whole = replace(floats, duration=1, record_start=0, speed_range=[500, 1000])
    assert whole.fingerprint == floats.fingerprint
    gravity = replace(floats, mechanism=replace(SliderCrank(), gravity=(0, -9)))
    made = (tmp_path / "data", gravity.labels([0]), ("rod_b_axial",), 10, 10.0, 0.0)
    Dataset.create(*made, gravity.fingerprint, gravity.settings, simulator())
    same = replace(gravity, mechanism=replace(SliderCrank(), gravity=(0.0, -9.0)))
    Dataset.create(*made, same.fingerprint, same.settings, simulator())


def test_runs_of_another_simulator_are_told(tmp_path, monkeypatch):
    one, told = replace(SMALL, runs=1), list[str]()
    monkeypatch.setattr(stored.log, "warning", lambda text, *of: told.append(text % of))
    labels, path = one.labels([0]), tmp_path / "data"
    made = (path, labels, ("rod_b_axial",), 10, 10.0, 0.0, one.fingerprint, one.settings)
    Dataset.create(*made, "an older one")
    assert not told
    Dataset.create(*made, simulator())
    assert [str(path) in line and "another version of the simulator" in line for line in told] == [True]
    assert one.folder not in (one.fingerprint, replace(one, seed=2).folder)


@pytest.mark.parametrize(
    ("random", "said"),
    [
        ({"joint_c.clearance": (0.0, 1e-3)}, "may be drawn"),
        ({"drive.speed_rpm": (500.0, 600.0)}, "may be drawn"),
        ({"joint_c.contact": (0.0, 1.0)}, "may be drawn"),
        ({"gravity.1": (0.0, -9.81)}, "falls"),
        ({"gravity.1": (0.0,)}, "list of 2 numbers"),
        ({"gravity.1": -9.81}, "list of 2 numbers"),
        ((1, 2), "no mapping"),
        ({"joint_b.clearance": (-1e-3, 1e-4)}, "outside"),
        ({"gravity.7": (0.0, 1.0)}, "has no '7'"),
    ],
)
def test_what_cannot_be_drawn_is_refused(random, said):
    with pytest.raises(InputError, match=said):
        replace(SMALL, random=random)


def test_what_is_missing_is_made_again_and_nothing_else(whole, tmp_path):
    dataset = SMALL.generate(tmp_path / "data")
    chunk = tmp_path / "data" / "signals" / "c"
    kept = (chunk / "3" / "0" / "0").stat().st_mtime_ns
    (chunk / "7" / "0" / "0").unlink()
    assert dataset.missing().tolist() == [7]
    again = SMALL.generate(tmp_path / "data")
    np.testing.assert_array_equal(contents(again), contents(whole))
    assert (chunk / "3" / "0" / "0").stat().st_mtime_ns == kept


@pytest.mark.parametrize("damage", ["flip", "cut", "empty"])
def test_a_damaged_chunk_is_found_and_named(tmp_path, damage):
    dataset = replace(SMALL, runs=2).generate(tmp_path / "data")
    chunk = tmp_path / "data" / "signals" / "c" / "1" / "0" / "0"
    bytes_ = bytearray(chunk.read_bytes())
    if damage == "flip":
        bytes_[1000] ^= 1
    chunk.write_bytes({"flip": bytes(bytes_), "cut": bytes(bytes_[:-50]), "empty": b""}[damage])
    dataset.read(0)
    with pytest.raises(InputError, match=r"run 1 is damaged.*signals/c/1/0/0"):
        dataset.read(1)


def test_other_settings_do_not_mix(tmp_path):
    replace(SMALL, runs=1).generate(tmp_path / "data")
    other = replace(SMALL, seed=6, integrator=Integrator(step=5e-6))
    with pytest.raises(InputError, match=r"integrator\.step: 1e-05 there, 5e-06 here.*seed"):
        other.generate(tmp_path / "data")


def test_foreign_folders_are_refused(tmp_path):
    with pytest.raises(InputError, match="not there"):
        Dataset.open(tmp_path / "nothing")
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "zarr.json").write_text("{]")
    with pytest.raises(InputError, match="not a data set"):
        Dataset.open(tmp_path / "foreign")


def test_a_failed_run_is_recorded_and_not_tried_again(tmp_path, monkeypatch):
    wild = replace(
        SMALL, runs=3, integrator=Integrator(step=1e-3), chain=MeasurementChain(base_rate=1e3, decimation=1),
        duration=3.0, record_start=0.5, clearance_range=(1e-4, 2e-4),
    )  # fmt: skip
    dataset = wild.generate(tmp_path / "data")
    assert len(dataset.failures()) == 3
    assert "joint C" in dataset.failures()[0]
    assert dataset.missing().size == 0
    assert dataset.available().size == 0
    asked: list[object] = []
    monkeypatch.setattr(synthesis, "run_batch", lambda machines, *_: asked.extend(machines))
    wild.generate(tmp_path / "data")
    assert asked == []


def test_fresh_runs_are_new_at_each_epoch_and_belong_to_no_data_set(whole):
    signals, labels = SMALL.fresh(3, 0, ACCELERATIONS)
    again, _ = SMALL.fresh(3, 0, ACCELERATIONS[::-2])
    later, later_labels = SMALL.fresh(3, 1, ACCELERATIONS)
    assert signals[0].shape == (500, 10)
    np.testing.assert_array_equal(signals[1][:, ::-2], again[1])
    everything = np.concatenate([whole.labels["clearance_c"], labels[:, 1], later_labels[:, 1]])
    assert len(np.unique(everything)) == len(everything)
    assert not np.array_equal(signals[0], later[0])


def test_a_killed_writer_loses_nothing_but_what_was_in_flight(whole, tmp_path):
    program = (
        "import sys; sys.path.insert(0, sys.argv[2])\n"
        "from tests.recording.test_dataset import SMALL\n"
        "from dataclasses import replace\n"
        "replace(SMALL, duration=1.0, record_start=0.2, runs=48).generate(sys.argv[1], workers=1)\n"
    )
    root = str(Path(__file__).resolve().parents[2])
    writer = subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path / "data"), root], stderr=subprocess.DEVNULL
    )
    folder = tmp_path / "data" / "signals" / "c"
    deadline = time.time() + 120
    while time.time() < deadline and not (folder.is_dir() and len(list(folder.iterdir())) > 3):
        time.sleep(0.01)
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    campaign = replace(SMALL, duration=1.0, record_start=0.2, runs=48)
    left = Dataset.open(tmp_path / "data").available()
    assert left.size > 0
    resumed = campaign.generate(tmp_path / "data")
    uninterrupted = campaign.generate(tmp_path / "other")
    np.testing.assert_array_equal(contents(resumed), contents(uninterrupted))


def test_a_data_set_is_laid_out_whole_or_not_at_all(tmp_path, monkeypatch):
    class Killed(BaseException):
        pass

    def killed(self, target):
        raise Killed

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", killed)
        with pytest.raises(Killed):
            SMALL.generate(tmp_path / "data")
    assert not (tmp_path / "data").exists()
    assert replace(SMALL, runs=1).generate(tmp_path / "data").available().tolist() == [0]


@pytest.mark.parametrize("step", ["__setitem__", "resize"])
def test_a_kill_while_growing_leaves_a_data_set_that_grows_again(whole, tmp_path, monkeypatch, step):
    class Killed(BaseException):
        pass

    kind = type(replace(SMALL, runs=3).generate(tmp_path / "data")._signals)
    plain = getattr(kind, step)

    def killed(array, *arguments):
        if step == "resize" and array.ndim == 2:  # the labels'; the signals' is the last step
            return plain(array, *arguments)
        raise Killed

    with monkeypatch.context() as patched:
        patched.setattr(kind, step, killed)
        with pytest.raises(Killed):
            SMALL.generate(tmp_path / "data")
    left = Dataset.open(tmp_path / "data")
    assert (left.runs, left.available().tolist()) == (3, [0, 1, 2])
    np.testing.assert_array_equal(contents(SMALL.generate(tmp_path / "data")), contents(whole))


def test_a_folder_with_something_else_is_left_alone(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="holds something else"):
        SMALL.generate(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_damaged_labels_are_named(tmp_path):
    replace(SMALL, runs=2).generate(tmp_path / "data")
    chunk = tmp_path / "data/labels/c/0/0"
    chunk.write_bytes(chunk.read_bytes()[:-3])
    with pytest.raises(InputError, match=r"labels of .*data are damaged"):
        _ = Dataset.open(tmp_path / "data").labels


def test_clearances_of_a_worn_bore_begin_where_its_lobes_leave_some(tmp_path):
    """What a diagnosis corrected is simulated with the usual range."""
    worn = replace(SliderCrank(), joint_c=Joint(3e-4, bearing=Worn(amplitude=2e-5, order=3)))
    campaign = replace(SMALL, mechanism=worn, clearance_range=(0.0, 4e-5))
    found = campaign.labels(range(200))[:, 1]
    assert 2.2e-5 <= found.min() < 2.3e-5
    assert found.max() <= 4e-5
    made = replace(campaign, runs=8).generate(tmp_path / "data")
    assert len(made.available()) == 8  # none blew up
