"""The folder of a training: what a kill leaves, and what is finished stays."""

import pytest

from clearance.errors import InputError
from clearance.models import run_folder
from clearance.models.run_folder import RunFolder
from clearance.whole_files import read_yaml


class Killed(Exception):
    pass


def test_a_training_in_place_of_another_is_not_bound_to_its_recordings(tmp_path, monkeypatch):
    RunFolder.open(tmp_path, {"seed": 1}, 1).begin("formerly")
    anew = RunFolder.open(tmp_path, {"seed": 2}, 2)

    def killed(*_):
        raise Killed

    with monkeypatch.context() as patch:  # between config.yaml and begun.json
        patch.setattr(run_folder, "write_json", killed)
        with pytest.raises(Killed):
            anew.begin("now")
    assert read_yaml(tmp_path / "config.yaml") == {"seed": 2}
    again = RunFolder.open(tmp_path, {"seed": 2}, 2)
    again.begin("now")
    with pytest.raises(InputError, match="its recordings have changed"):
        again.begin("other")


def test_a_finished_training_keeps_its_configuration_and_its_recordings(tmp_path):
    run = RunFolder.open(tmp_path, {"seed": 1, "overrides": ["seed=1"]}, 1)
    run.begin("those")
    run.finish({})
    again = RunFolder.open(tmp_path, {"seed": 1, "overrides": ["seeds=[1,2]"]}, 1)
    again.begin("those")
    assert read_yaml(tmp_path / "config.yaml")["overrides"] == ["seed=1"]
    with pytest.raises(InputError, match="its recordings have changed"):
        again.begin("others")
