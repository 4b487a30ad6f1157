"""The command that ranks sensors: what it writes, what it says, what it refuses."""

import json
import shlex

import pytest

from clearance.configuration import CONFIGURATION, with_mechanism_file, with_mechanism_path
from clearance.placement import best_by_size, training
from tests.command_line import call


def test_it_ranks_sets_and_writes_a_file_and_a_picture(monkeypatch, capfd, tmp_path):
    code, _ = call(
        monkeypatch, capfd, "placement", "conditions.clearances=[3e-4]", "conditions.speeds=[700]", "most=2",
        "sensors.channels=[rod_b_axial,slider_vertical,slider_horizontal]", "workers=1",
        f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert code == 0
    found = json.loads((tmp_path / "placement.json").read_text())
    first, last = found["ranking"][0], found["ranking"][-1]
    assert len(found["ranking"]) == 6
    assert first["channels"] == ["rod_b_axial", "slider_horizontal"]
    assert last["channels"] == ["slider_vertical"]
    assert 0.0 < first["error_m"] < 1e-6 < last["error_m"]
    assert found["sensors"]["default"]["noise_density"] == pytest.approx(1.23e-3)
    assert (tmp_path / "placement.png").read_bytes().startswith(b"\x89PNG")


def test_where_noise_is_a_share_a_channel_that_shows_nothing_tells_nothing(monkeypatch, capfd, tmp_path):
    share = ("sensor_chain.default.noise_density=0", "+sensor_chain.default.noise=0.01", "most=1")
    few = ("sensors.channels=[rod_b_axial,slider_vertical]", f"hydra.run.dir={tmp_path}", "workers=1")
    one = ("conditions.clearances=[3e-4]", "conditions.speeds=[700]")
    assert call(monkeypatch, capfd, "placement", *share, *few, *one)[0] == 0
    first, last = json.loads((tmp_path / "placement.json").read_text())["ranking"]
    assert (first["channels"], last["channels"]) == (["rod_b_axial"], ["slider_vertical"])
    assert first["error_m"] < 0.05 * last["error_m"]


def test_of_three_sensors_no_four_are_asked_for(monkeypatch, capfd, tmp_path):
    few = ("sensors.channels=[rod_b_axial,slider_vertical,slider_horizontal]", f"hydra.run.dir={tmp_path}")
    one = ("conditions.clearances=[3e-4]", "conditions.speeds=[700]", "workers=1")
    assert call(monkeypatch, capfd, "placement", *few, *one)[0] == 0
    assert len(json.loads((tmp_path / "placement.json").read_text())["ranking"]) == 7
    code, error = call(monkeypatch, capfd, "placement", *few, "most=4")
    assert code == 2
    assert "most = 4 is not a whole number from 1 to 3; change most" in error


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("joint=both", "joint=both"),
        ("sensors.channels=[crank_angle]", "crank_angle"),
        ("most=11", "most = 11"),
        ("best=0", "best = 0"),
        ("sensor_chain=ideal", "without noise"),
        ("integrator=euler", "leave integrator out"),
        ("integrator.step=5e-6", "leave integrator out"),
        ("chain.base_rate=4000", "at least 500 Hz"),
    ],
)
def test_wrong_input_is_one_line(monkeypatch, capfd, tmp_path, override, words):
    code, error = call(monkeypatch, capfd, "placement", override, f"hydra.run.dir={tmp_path}")
    assert code == 2
    assert words in error
    assert len(error.strip().splitlines()) == 1


def test_the_best_of_each_size_and_how_to_train_on_them():
    ranking = [
        {"channels": list(names), "error_m": i * 1e-7} for i, names in enumerate(["ab", "a", "ac", "b", "bc"])
    ]
    assert [[one["channels"] for one in group] for group in best_by_size(ranking, 2)] == [
        [["a"], ["b"]],
        [["a", "b"], ["a", "c"]],
    ]
    own = ["most=2", "sensors.channels=[a,b,c]", "conditions.window=0.01"]
    asked = ["joint=B", *own, "mechanism.rod.mass=0.3"]
    assert training(ranking[:2], asked) == (
        "to train on the best: python -m clearance.train -m model=tcn sensor_chain=mems joint=B "
        "mechanism.rod.mass=0.3 'sensors.channels=[a,b],[a]'"
    )
    louder = ["+sensor_chain.default.noise=0.01"]
    assert "sensor_chain=mems +sensor_chain.default.noise=0.01 " in training(ranking[:2], louder)
    assert "sensor_chain=mems" not in training(ranking[:2], ["sensor_chain=ideal"])


def test_what_to_train_has_the_ranked_machines_file(monkeypatch, capfd, tmp_path):
    file = tmp_path / "my rig.yaml"
    file.write_text((CONFIGURATION / "mechanism/slider_crank.yaml").read_text())
    code, _ = call(
        monkeypatch, capfd, "placement", f"mechanism={file}", "conditions.clearances=[3e-4]", "most=1",
        "conditions.speeds=[700]", "sensors.channels=[rod_b_axial]", "workers=1", "chain.decimation=5",
        f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert code == 0
    assert json.loads((tmp_path / "placement.json").read_text())["chain"]["decimation"] == 5
    assert with_mechanism_path(with_mechanism_file(f"mechanism={file}")) == f"mechanism={file}"
    assert with_mechanism_path("mechanism=slider_crank") == "mechanism=slider_crank"
    best = [{"channels": ["rod_b_axial"], "error_m": 1e-7}]
    advice = training(best, [with_mechanism_file(f"mechanism={file}")])
    assert shlex.quote(f"mechanism={file}") in advice
