"""Each `data=` option trains: recordings from a store, from files, and simulated anew every epoch."""

import json

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.errors import InstantiationException
from hydra.utils import instantiate

from clearance.commands import CONFIGURATION
from clearance.errors import InputError
from clearance.recording.files import write
from clearance.recording.recording import Recording
from clearance.recording.synthesis import Campaign
from clearance.windows.sources import StoredSource
from tests.command_line import SMALL, TREES, call

RUNS = 6


def composed(*overrides):
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return compose("train", [*SMALL, f"runs={RUNS}", *overrides])


@pytest.fixture(scope="module")
def campaign():
    return instantiate(composed().campaign, _convert_="all")


@pytest.fixture(scope="module")
def stored(campaign, tmp_path_factory):
    return campaign.generate(tmp_path_factory.mktemp("stored") / "data")


@pytest.fixture(scope="module")
def measured(campaign, tmp_path_factory):
    folder = tmp_path_factory.mktemp("measured")
    rows = ["path,clearance_b,clearance_c,speed,group"]
    for run in range(RUNS):
        recording = campaign.recording(run)
        truth = recording.metadata["truth"]
        write(recording, folder / f"{run}.parquet")
        rows.append(f"{run}.parquet,{1e-5 * run},{truth['clearance_c']},{truth['speed']},")
    (folder / "list.csv").write_text("\n".join(rows))
    return folder / "list.csv"


def loaded(*overrides):
    data = instantiate(composed(*overrides).data, _convert_="all")
    data.prepare_data()
    data.setup()
    return data


@pytest.mark.parametrize("kind", ["stored", "measured", "simulated", "streaming"])
def test_memory_is_bounded_whatever_the_source(kind, stored, measured, tmp_path):
    where = {
        "stored": [f"data.source.path={stored.path}"], "measured": [f"data.source.path={measured}"],
        "simulated": [f"data.source.folder={tmp_path}"], "streaming": [],
    }  # fmt: skip
    with pytest.raises(InputError, match=r"data\.memory_gib"):
        loaded(f"data={kind}", *where[kind], "data.memory_gib=1e-6")


def test_files_and_a_store_of_the_same_runs_are_the_same_data(stored, measured):
    one = loaded("data=stored", f"data.source.path={stored.path}")
    two = loaded("data=measured", f"data.source.path={measured}")
    np.testing.assert_array_equal(one.recordings.target, two.recordings.target)
    # Equal to the last bits of single precision, in which the store keeps what the files hold in double.
    np.testing.assert_allclose(one.recordings.signals, two.recordings.signals, rtol=1e-5, atol=1e-5)
    assert one.recordings.chain == two.recordings.chain


def test_files_may_be_known_by_the_clearances_of_both_joints(measured):
    both = loaded("data=measured", f"data.source.path={measured}", "joint=unknown").recordings.target
    assert both[:, 0] == pytest.approx(1e-5 * np.arange(RUNS))
    one = loaded("data=measured", f"data.source.path={measured}").recordings.target
    np.testing.assert_array_equal(both[:, 1:], one)


@pytest.mark.parametrize("groups", [["0", "0", "1", "1", "2", "2"], ["", "1", "", "", "1", ""]])
def test_recordings_of_a_group_stay_together_whatever_it_is_called(measured, groups):
    rows = measured.read_text().splitlines()
    grouped = measured.with_name("groups.csv")
    grouped.write_text(
        "\n".join([rows[0], *(row + group for row, group in zip(rows[1:], groups, strict=True))])
    )
    found = loaded("data=measured", f"data.source.path={grouped}", "data.split.train=0.5").recordings.groups
    for i, one in enumerate(groups):
        for j, other in enumerate(groups):
            assert (found[i] == found[j]) == (i == j or (one == other != "")), (i, j)


def test_a_list_may_come_from_a_spreadsheet(measured):
    table = measured.with_name("spreadsheet.csv")
    table.write_text(
        "\ufeff" + measured.read_text().replace(",", ";").replace(".", ",").replace(",parquet", ".parquet")
    )
    one, other = (
        loaded("data=measured", f"data.source.path={path}").recordings for path in (measured, table)
    )
    np.testing.assert_array_equal(one.target, other.target)
    np.testing.assert_array_equal(one.speed, other.speed)


def test_rates_of_real_clocks_are_one_rate_and_others_are_not(measured, campaign):
    recording = campaign.recording(0)
    for name, rate in (("slow", 0.9995e4), ("other", 1.002e4)):
        write(Recording(recording.values, recording.channels, rate, 0.1), measured.parent / f"{name}.parquet")
    for name in ("slow", "other"):
        measured.with_name(f"{name}.csv").write_text(f"{measured.read_text()}\n{name}.parquet,0,1e-4,60,\n")
    assert (
        loaded("data=measured", f"data.source.path={measured.with_name('slow.csv')}").recordings.rate == 1e4
    )
    with pytest.raises(InputError, match=r"other.csv: recordings at \[10000.0, 10020.0\] Hz: .*within 0.1%"):
        loaded("data=measured", f"data.source.path={measured.with_name('other.csv')}")


def test_what_is_wrong_with_a_recording_of_a_list_names_its_file(measured, campaign):
    write(campaign.recording(0).select(("slider_horizontal",)), measured.parent / "slider.parquet")
    wrong = measured.with_name("slider.csv")
    wrong.write_text(measured.read_text() + "\nslider.parquet,0,1e-4,60,\n")
    with pytest.raises(InputError, match=r"slider.parquet: the recording has no channel"):
        loaded("data=measured", f"data.source.path={wrong}")


def test_a_recording_that_is_listed_twice_is_refused(measured):
    wrong = measured.with_name("twice.csv")
    for again in ("3.parquet", "./3.parquet"):
        wrong.write_text(measured.read_text() + f"\n{again},0,1e-4,60,\n")
        with pytest.raises(InputError, match=r"twice\.csv: 3\.parquet occurs 2 times: .*; leave one entry"):
            loaded("data=measured", f"data.source.path={wrong}")


def test_a_speed_that_is_no_number_is_named(measured):
    wrong = measured.with_name("speeds.csv")
    wrong.write_text("path,clearance_c,speed\n0.parquet,1e-4,600 rpm\n")
    with pytest.raises(InputError, match=r"speed='600 rpm': must be a number \[rad/s\]"):
        loaded("data=measured", f"data.source.path={wrong}")


def test_only_clearances_of_the_joints_are_estimated():
    with pytest.raises(InstantiationException, match=r"targets=\['speed'\]: must be \[clearance_b\] or"):
        loaded("targets=[speed]")


def test_streamed_training_runs_change_every_epoch_and_others_do_not(campaign):
    data = loaded("data=streaming", "runs=4", "data.source.held_out=3")
    first = {name: getattr(data, f"{name}_windows")() for name in ("training", "validation", "test")}
    signals, targets = first["training"].signals.clone(), first["training"].target.clone()
    later = data.training_windows(epoch=1)
    training = slice(0, 4 * campaign.sampling.samples)
    assert not np.array_equal(later.signals[training], signals[training])
    np.testing.assert_array_equal(later.signals[training.stop :], signals[training.stop :])
    assert not np.array_equal(later.target, targets)
    np.testing.assert_array_equal(data.validation_windows().target, first["validation"].target)


def test_what_an_epoch_streams_does_not_depend_on_the_epochs_before(monkeypatch):
    whole = Campaign.fresh

    def one_fails(self, runs, epoch, channels):
        signals, labels = whole(self, runs, epoch, channels)
        return (signals[1:], labels[1:]) if epoch == 2 else (signals, labels)

    monkeypatch.setattr(Campaign, "fresh", one_fails)
    through, resumed = (loaded("data=streaming", "runs=3", "data.source.held_out=1") for _ in range(2))
    for epoch in (1, 2):
        last = through.training_windows(epoch)
    first = resumed.training_windows(2)
    np.testing.assert_array_equal(last.target, first.target)
    np.testing.assert_array_equal(last.signals, first.signals)
    assert len(np.unique(first.target)) == 2


def test_streamed_runs_that_all_fail_in_a_later_epoch_are_one_line(monkeypatch):
    data = loaded("data=streaming", "runs=3", "data.source.held_out=1")
    monkeypatch.setattr(Campaign, "fresh", lambda *_: ([], np.empty((0, 3))))
    with pytest.raises(InputError, match=r"all of 3 runs of epoch 2 became non-finite"):
        data.training_windows(1)


def test_samples_before_the_start_time_are_left_out(stored):
    asked = (stored.channels, ("clearance_c",), 2**30)
    whole, later = (StoredSource(str(stored.path), start).load(*asked) for start in (0.1, 0.15))
    np.testing.assert_array_equal(later.recording(2), whole.recording(2)[500:])  # 0.05 s at 10 kHz
    with pytest.raises(InputError, match=r"start_time=0\.3 s: the data set ends at 0\.3"):
        StoredSource(str(stored.path), 0.3).load(*asked)


def test_streamed_runs_that_all_fail_are_one_line(monkeypatch):
    monkeypatch.setattr(Campaign, "fresh", lambda *_: ([], np.empty((0, 3))))
    with pytest.raises(InputError, match=r"data=streaming: all of 6 runs .* became non-finite"):
        loaded("data=streaming")


@pytest.mark.parametrize("kind", ["stored", "measured", "streaming", "simulated"])
def test_every_source_trains_to_the_end(kind, stored, measured, tmp_path, monkeypatch, capfd):
    source = {
        "stored": [f"data.source.path={stored.path}"],
        "measured": [f"data.source.path={measured}"],
        "streaming": ["runs=4", "data.source.held_out=3"],
        "simulated": [f"runs={RUNS}"],
    }[kind]
    monkeypatch.chdir(tmp_path)
    overrides = (*SMALL, f"data={kind}", *source, "hydra.run.dir=run")
    code, error = call(monkeypatch, capfd, "train", *overrides)
    assert code == 0, error
    metrics = json.loads((tmp_path / "run/metrics.json").read_text())
    assert 0 < metrics["test"]["nmae"] < 200


def test_a_list_of_files_from_different_chains_is_refused(measured, campaign):
    recording = campaign.recording(0)
    other = {**recording.metadata, "chain": {"cutoff": 0.5}}
    write(
        Recording(recording.values, recording.channels, recording.rate, 0.1, other),
        measured.parent / "x.parquet",
    )
    wrong = measured.with_name("wrong.csv")
    wrong.write_text(measured.read_text() + "\nx.parquet,0,1e-4,60,\n")
    with pytest.raises(InputError, match=r"wrong.csv: recordings with different chains .*0\.8.*0\.5"):
        loaded("data=measured", f"data.source.path={wrong}")


def test_a_gauge_remembers_the_chain_of_its_training():
    assert (
        loaded("chain.cutoff=0.7", "data=streaming", "runs=3", "data.source.held_out=1").recordings.chain[
            "cutoff"
        ]
        == 0.7
    )


@pytest.mark.parametrize(
    ("overrides", "place"),
    [
        ([], 0.12),
        (["mechanism.sensor_positions=[0,0.05,0.02,0.1]"], 0.1),
        (["+campaign.random={rod.length:[0.11,0.13]}"], None),
    ],
)
def test_a_gauge_remembers_where_the_sensors_of_its_training_were(overrides, place):
    data = loaded("data=streaming", "runs=3", "data.source.held_out=1", *overrides)
    assert data.recordings.positions.get("rod_c_axial") == place


def test_where_the_sensors_of_a_list_are_is_what_all_its_recordings_declare(measured, campaign):
    own = measured.with_name("places.csv")
    rows = measured.read_text().splitlines()
    places = RUNS // 2 * [{"rod_b_axial": 0.0, "rod_c_axial": 0.1}, {"rod_c_axial": 0.1}]
    places.append({"rod_c_axial": 0.12})
    for run, declared in enumerate(places):
        path = measured.with_name(f"placed-{run}.parquet")
        write(campaign.recording(run), path)
        sensors = {name: {"position": place} for name, place in declared.items()}
        path.with_suffix(".yaml").write_text(json.dumps({"sensors": sensors}))
    listed = [f"placed-{run}.parquet,0,{1e-4 * (run + 1)},60," for run in range(RUNS)]
    own.write_text("\n".join([rows[0], *listed]))
    assert loaded("data=measured", f"data.source.path={own}").recordings.positions == {"rod_c_axial": 0.1}
    own.write_text("\n".join([rows[0], *listed, f"placed-{RUNS}.parquet,0,1e-4,60,"]))
    with pytest.raises(InputError, match=r"sensor rod_c_axial at 0\.1 m and at 0\.12 m: one common place"):
        loaded("data=measured", f"data.source.path={own}")


@pytest.mark.parametrize("end", ["finished", "killed"])
def test_files_that_have_changed_are_another_training(measured, tmp_path, monkeypatch, capfd, end):
    monkeypatch.chdir(tmp_path)
    own = measured.with_name(f"{end}.csv")
    own.write_text(measured.read_text())
    train = ("train", *TREES, "hydra.run.dir=run", "data=measured", f"data.source.path={own}")
    assert call(monkeypatch, capfd, *train) == (0, "")
    weights = (tmp_path / "run/model.ubj").stat().st_mtime_ns
    if end == "killed":
        (tmp_path / "run/metrics.json").unlink()
    assert call(monkeypatch, capfd, *train) == (0, "")
    assert (weights == (tmp_path / "run/model.ubj").stat().st_mtime_ns) == (end == "finished")
    own.write_text(measured.read_text().rsplit("\n", 1)[0])
    if end == "killed":
        (tmp_path / "run/metrics.json").unlink()
    code, error = call(monkeypatch, capfd, *train)
    assert (code, error.count("\n")) == (2, 1)
    assert "run: its recordings have changed; resume=false trains again" in error
    assert (tmp_path / "run/model.ubj").exists()
    assert call(monkeypatch, capfd, *train, "resume=false") == (0, "")
    assert call(monkeypatch, capfd, *train) == (0, "")


def test_runs_that_are_still_missing_are_told(campaign, tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(
        "clearance.windows.sources.log.warning", lambda text, *words: told.append(text % words)
    )
    store = campaign.generate(tmp_path / "data")
    loaded("data=stored", f"data.source.path={store.path}")
    assert told == []
    store._chunk(2).unlink()
    loaded("data=stored", f"data.source.path={store.path}")
    assert len(told) == 1
    assert "data: 1 of its 6 runs are not simulated yet" in told[0]


def test_runs_that_are_lost_after_their_simulation_are_not_trained_without(tmp_path):
    data = instantiate(composed(f"data.source.folder={tmp_path}").data, _convert_="all")
    data.prepare_data()
    next(tmp_path.rglob("signals/c/2/0/0")).unlink()
    with pytest.raises(InputError, match=f"has lost 1 of its {RUNS} runs since"):
        data.setup()


def test_a_list_may_have_blanks_behind_its_commas(measured):
    table = measured.with_name("BLANKS.CSV")
    table.write_text(measured.read_text().replace(",", ", "))
    one, other = (
        loaded("data=measured", f"data.source.path={path}").recordings for path in (measured, table)
    )
    np.testing.assert_array_equal(one.target, other.target)
