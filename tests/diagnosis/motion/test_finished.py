"""What an earlier run on recordings without accelerometers has finished is not made again."""

import os
import signal
from dataclasses import replace

import pytest

from clearance.diagnosis.motion import search
from tests.diagnosis.motion.test_motion import diagnosed, named, planted


def test_another_run_makes_no_fit_anew_that_an_earlier_one_has_finished(tmp_path, monkeypatch):
    recording, names = planted(4.0, 100.0, effects={"gravity": {"gravity_y": -9.81}}), ["gravity"]
    before = diagnosed(recording, names, finished=tmp_path)

    def never(*_):
        raise AssertionError("made again")

    monkeypatch.setattr(search, "fit", never)
    again = diagnosed(recording, names, finished=tmp_path)
    for told in (before, again):
        told.pop("seconds")
        told.pop("peak_memory_mib")
    assert "gravity" in named(again)
    for told in (before, again):
        held = told.pop("fit")["held_out"]
        assert held["before"] > 2.0 > held["after"]
    assert before == again
    for other in (replace(recording, values=1.001 * recording.values), replace(recording, rate=101.0)):
        with pytest.raises(AssertionError, match="made again"):
            diagnosed(other, names, finished=tmp_path)
    with pytest.raises(AssertionError, match="made again"):
        diagnosed(recording, ["gravity", "slider_offset"], finished=tmp_path)


def test_a_search_that_was_stopped_keeps_nothing_more(tmp_path, handled):
    recording = planted(4.0, 100.0, effects={"gravity": {"gravity_y": -9.81}})

    def report(text):
        if "machine as it is" in text:
            os.kill(os.getpid(), signal.SIGINT)

    handled(signal.SIGINT, lambda *_: None)
    diagnosed(recording, ["gravity"], report=report, finished=tmp_path)
    stopped = len(list(tmp_path.rglob("*.npz")))
    assert "gravity" in named(diagnosed(recording, ["gravity"], finished=tmp_path))
    assert 0 < stopped < len(list(tmp_path.rglob("*.npz")))
