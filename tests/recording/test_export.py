"""``clearance.simulate recordings=``: files that go on after a kill, in shards, past runs that fail."""

from dataclasses import replace

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from clearance.configuration import CONFIGURATION
from clearance.errors import InputError
from clearance.recording import synthesis
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.files import read
from clearance.recording.sensors import Sensor, SensorChain
from tests.command_line import call

SHORT = ("runs=4", "campaign.duration=0.3", "campaign.record_start=0.1")


@pytest.fixture(scope="module")
def campaign():
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return instantiate(compose("simulate", list(SHORT)).campaign, _convert_="all")


def test_a_killed_export_goes_on_and_shards_are_parts_of_it(campaign, tmp_path):
    odd = campaign.export(tmp_path, (2, 2))
    assert [path.name for path in odd] == ["run-000001.parquet", "run-000003.parquet"]
    before = [path.stat().st_mtime_ns for path in odd]
    every = campaign.export(tmp_path)
    assert sorted(tmp_path.iterdir()) == every
    assert len(every) == 4
    assert [path.stat().st_mtime_ns for path in odd] == before
    assert len(replace(campaign, runs=5).export(tmp_path)) == 5  # more of the same


def test_recordings_of_other_settings_are_kept(campaign, tmp_path):
    (path, *_) = campaign.export(tmp_path, (1, 4))
    content = path.read_bytes()
    with pytest.raises(InputError, match=r"run-000000\.parquet is of other settings, or of an older version"):
        replace(campaign, seed=5).export(tmp_path)
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [content]


def test_a_run_that_fails_is_told_and_the_others_are_written(campaign, tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(synthesis.log, "warning", lambda text, *words: told.append(text % words))
    plain = synthesis.run_batch

    def failing(machines, integrator, sampling, sink, workers):
        failure = synthesis.Failure(0.1, "contact of joint C", dict.fromkeys(STATE, 0.0))
        plain(
            machines, integrator, sampling,
            lambda index, outcome: sink(index, failure if index == 1 else outcome), workers,
        )  # fmt: skip

    monkeypatch.setattr(synthesis, "run_batch", failing)
    paths = campaign.export(tmp_path)
    assert [path.name for path in paths] == [f"run-{run:06d}.parquet" for run in (0, 2, 3)]
    assert len(told) == 1
    assert told[0].startswith("run 1 is left out: the run became non-finite at t = 0.1")
    assert read(paths[0]).metadata["truth"]["clearance_c"] == campaign.labels([0])[0, 1]


def test_sensors_of_all_channels_are_simulated_and_the_accelerations_have_the_noise_of_a_data_set(campaign):
    sensors = SensorChain({"crank_angle": {"resolution": 0.01}, "crank_speed": {"noise_density": 1e-3}})
    ideal = campaign.recording(0)
    noisy = replace(campaign, sensors=replace(sensors, default=Sensor(noise_density=0.01)))
    made = noisy.recording(0)
    counts = made.channel("crank_angle") / 0.01
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert np.ptp(made.channel("crank_angle") - ideal.channel("crank_angle")) > 0.005
    assert np.std(made.channel("crank_speed") - ideal.channel("crank_speed")) == pytest.approx(0.07, rel=0.2)
    for name in ("drive_torque", "slider_position", "slider_velocity"):
        np.testing.assert_array_equal(made.channel(name), ideal.channel(name))
    observed = noisy.observe(0, ideal.values)
    np.testing.assert_array_equal(made.select(ACCELERATIONS).values, observed)
    assert made.metadata == ideal.metadata


STATE = ("crank_angle", "crank_speed", "rod_angle", "rod_speed", "slider_x", "slider_x_rate")


def test_a_data_set_and_recordings_are_not_made_at_once(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    code, error = call(monkeypatch, capfd, "simulate", *SHORT, "dataset=a", "recordings=b")
    assert (code, error.count("\n")) == (2, 1)
    assert "dataset=a and recordings=b: one of both; set the other to null" in error
    assert not {"a", "b"} & {path.name for path in tmp_path.iterdir()}
    assert call(monkeypatch, capfd, "simulate", *SHORT, "shard=1/2", "recordings=b")[0] == 0
    assert len(list((tmp_path / "b").iterdir())) == 2
