"""What an earlier run has finished is not made again, and is the same."""

import os
from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.following.finished import Finished, kept_in
from clearance.diagnosis.following.kept import _KEPT, _make_room
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.searching import one_by_one
from clearance.diagnosis.searching import search as searching
from clearance.diagnosis.searching.location import locate_joint
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.strategy import find_explanation
from clearance.diagnosis.sensing.demonstration import record
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import Measured, chain_of
from clearance.diagnosis.sensing.tolerances import Tolerances
from clearance.errors import InputError
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.slider_crank import SliderCrank

SETTING, SPEEDS = Setting(SliderCrank(), "C"), (50.0, 150.0)


@pytest.fixture(scope="module")
def measured():
    machine = replace(SETTING.with_clearance(2e-4), drive=SpeedControl(700.0, ramp=0.1), gravity=(0.0, -4.0))
    recording = record(machine, 3)
    return Measured.of(recording, chain_of(recording, "one"), "one").part(0, 260)


def number(finished, label, make):
    """Something small that is kept."""
    return finished.recall(
        label, make, lambda one: {"number": np.array(one)}, lambda kept: float(kept["number"])
    )


def run(measured, folder, report=lambda _: None):
    effects = load_effects(["gravity"], [])
    search, explanation, _ = locate_joint([measured], [SETTING], effects, SPEEDS, 1, report, finished=folder)
    search.most = 1
    find_explanation(search, explanation, lambda _: None)
    return search, explanation


@pytest.fixture(scope="module")
def first(measured, tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    return folder, run(measured, folder)


def never(*_, **__):
    raise AssertionError("made again")


def test_another_run_goes_on_from_what_was_finished(first, measured, monkeypatch):
    folder, (_, before) = first
    for module, name in ((searching, "profile"), (searching, "refine"), (one_by_one, "grow")):
        monkeypatch.setattr(module, name, never)
    for name in ("begin", "retrace", "grown"):
        monkeypatch.setattr(Search, name, never)
    _, after = run(measured, folder)
    assert [a.label for a in after.attempts] == [a.label for a in before.attempts] != []
    for one, other in zip([before.nominal, before.best], [after.nominal, after.best], strict=True):
        np.testing.assert_array_equal(one.fit.values, other.fit.values)
        assert one.misfit == pytest.approx(other.misfit, rel=1e-9)
        np.testing.assert_allclose(one.fit.information, other.fit.information, rtol=1e-6)


def test_sensors_that_were_calibrated_are_known_to_another_run(tmp_path, monkeypatch):
    recording = record(replace(SETTING.with_clearance(2e-4), drive=SpeedControl(700.0, ramp=0.1)), 3)
    gains = {"rod_b_axial": 1.03, "slider_horizontal": 0.98}
    seen = Instrument(gain=gains).apply(recording.values, recording.channels, recording.rate)
    off = replace(recording, values=seen)
    one = Measured.of(off, chain_of(off, "one"), "one").part(0, 260).within(Tolerances(gain=0.04))
    _, before = run(one, tmp_path)
    for name in ("begin", "retrace", "grown"):
        monkeypatch.setattr(Search, name, never)
    _, after = run(one, tmp_path)
    assert before.nominal.sensors.gain["rod_b_axial"] == pytest.approx(1.03, abs=5e-3)
    assert after.nominal.sensors == before.nominal.sensors
    np.testing.assert_array_equal(after.nominal.fit.values, before.nominal.fit.values)
    assert after.nominal.misfit == pytest.approx(before.nominal.misfit, rel=1e-9)
    np.testing.assert_allclose(
        after.nominal.fit.covariance, before.nominal.fit.covariance, rtol=1e-6, atol=1e-15
    )


def test_a_damaged_file_is_made_again(first, measured):
    folder, (_, before) = first
    damaged = next(iter(next(folder.iterdir()).glob("*.npz")))
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[: len(whole) // 2])
    _, after = run(measured, folder)
    np.testing.assert_array_equal(after.best.fit.values, before.best.fit.values)
    assert len(damaged.read_bytes()) == len(whole)


def test_other_recordings_settings_and_hypotheses_begin_anew(first, measured):
    folder, (search, _) = first
    known = (folder, search.recordings, search.alignments, search.setting, search.groups)
    names = {kept_in(*known)}
    names.add(kept_in(folder, [measured.part(0, 200)], *known[2:]))
    names.add(kept_in(*known[:3], Setting(replace(SliderCrank(), gravity=(0.0, -1.0)), "C"), known[4]))
    names.add(kept_in(*known[:4], {}))
    assert len(names) == 4
    assert kept_in(None, *known[1:]) is None


@pytest.mark.slow
def test_a_search_that_was_late_leaves_nothing_that_another_would_not_do(first, measured, tmp_path):
    _, (_, whole) = first
    search, _, _ = locate_joint(
        [measured], [SETTING], load_effects(["gravity"], []), SPEEDS, 1, lambda _: None, 0.0, tmp_path
    )
    assert search.late()
    kept = sorted(tmp_path.rglob("*.npz"))
    number(search.finished, "anything", lambda: 1.0)
    assert sorted(tmp_path.rglob("*.npz")) == kept != []
    _, after = run(measured, tmp_path)
    np.testing.assert_array_equal(after.best.fit.values, whole.best.fit.values)


def test_only_folders_of_its_own_are_cleared(tmp_path):
    theirs = tmp_path / "measurements"
    theirs.mkdir()
    (theirs / "a.npz").write_text("mine")
    mixed = tmp_path / f"{0:016x}"
    mixed.mkdir()
    (mixed / "notes.txt").write_text("mine")
    for i in range(1, 40):
        (tmp_path / f"{i:016x}").mkdir()
    Finished(tmp_path / f"{99:016x}", [], print)
    assert (theirs / "a.npz").exists()
    assert (mixed / "notes.txt").exists()
    assert len(list(tmp_path.iterdir())) < 35


def test_a_folder_that_cannot_be_made_is_named(measured, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="change finished"):
        run(measured, tmp_path / "file")


def test_what_time_has_cut_short_is_not_what_another_run_finds(tmp_path):
    first = Finished(tmp_path, [], lambda _: None)

    def cut() -> float:
        first.stop()
        return 1.0

    assert number(first, "glance", lambda: 3.0) == 3.0
    assert number(first, "glance", cut) == 1.0
    again = Finished(tmp_path, [], lambda _: None)
    assert number(again, "glance", never) == 3.0
    assert number(again, "glance", lambda: 2.0) == 2.0


def test_an_old_folder_that_is_in_use_again_is_not_removed(tmp_path):
    folders = [tmp_path / f"{i:016x}" for i in range(_KEPT + 1)]
    for place, folder in enumerate(folders):
        folder.mkdir()
        os.utime(folder, (1e9 + place, 1e9 + place))
    _make_room(folders[0])
    assert folders[0].exists()
    assert not folders[1].exists()
    assert len(list(tmp_path.iterdir())) == _KEPT
