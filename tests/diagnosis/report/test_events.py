"""What TensorBoard shows of a diagnosis."""

import matplotlib.image
import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from clearance.diagnosis.report import plain, write_events
from tests.diagnosis.report.examples import EXAMPLES

TRIED = [
    {"name": "nominal", "misfit": 8.1, "clearance_m": 3.11e-4},
    {"name": "guide_friction(coulomb_force)", "misfit": 1.04, "clearance_m": 3.0e-4},
]


def shown(folder, diagnosis, evidence):
    write_events(folder, plain(diagnosis), plain(evidence), TRIED)
    return EventAccumulator(str(folder)).Reload()


def test_likelihoods_parameters_and_what_was_tried_are_scalars(tmp_path):
    diagnosis, evidence = EXAMPLES["physics"]()
    found = shown(tmp_path, diagnosis, evidence)
    assert found.Scalars("misfit/guide_friction(coulomb_force)")[0].value == pytest.approx(1.04)
    assert found.Scalars("clearance/nominal")[0].value == pytest.approx(3.11e-4)
    for row in evidence["ranking"]:
        gains = [one.value for one in found.Scalars(f"log_likelihood_gain/{row['name']}")]
        assert pytest.approx(row["log_likelihood_gain"], rel=1e-6) in gains
    for effect in diagnosis["effects"]:
        for name, number in effect["parameters"].items():
            tag = f"parameter/{effect['name']}/{name}"
            for end, part in (("value", ""), ("low", "/low"), ("high", "/high")):
                assert found.Scalars(tag + part)[0].value == pytest.approx(number[end], rel=1e-6)


@pytest.mark.parametrize("example", EXAMPLES)
def test_pictures_are_drawn_of_what_is_known(tmp_path, example):
    diagnosis, evidence = EXAMPLES[example]()
    found = shown(tmp_path, diagnosis, evidence)
    tags = {"where": "where", "ranking": "what", "overlays": "how_much_better"}
    assert set(found.Tags()["images"]) == {tag for key, tag in tags.items() if evidence.get(key)}
    for tag in found.Tags()["images"]:
        (image,) = found.Images(tag)
        (tmp_path / "picture.png").write_bytes(image.encoded_image_string)
        pixels = matplotlib.image.imread(tmp_path / "picture.png")
        assert pixels.shape[:2] == (image.height, image.width)
        assert np.ptp(pixels[..., :3]) > 0.5  # something is on it


def test_what_nobody_knows_is_left_out(tmp_path):
    parameters = {"gap": {"value": 3e-5, "low": None, "high": 4e-5}}
    diagnosis = {"effects": [{"name": "guide_clearance", "parameters": parameters}]}
    ranking = [{"name": "gravity", "log_likelihood_gain": np.inf}]  # nominal paths that end in no number
    found = shown(tmp_path, diagnosis, {"where": {}, "ranking": ranking, "overlays": []})
    assert {tag for tag in found.Tags()["scalars"] if tag.startswith("parameter/")} == {
        "parameter/guide_clearance/gap", "parameter/guide_clearance/gap/high",
    }  # fmt: skip
    assert not any(tag.startswith("log_likelihood_gain") for tag in found.Tags()["scalars"])
    assert found.Tags()["images"] == []
