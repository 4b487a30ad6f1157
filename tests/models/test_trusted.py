import pytest

from clearance.errors import InputError
from clearance.models.trusted import instantiate_trusted


@pytest.mark.parametrize(
    "target",
    [
        "os.system",
        "builtins.eval",
        "clearance.models.neural.Path.unlink",
        "clearance.models.run_folder.shutil.rmtree",
        "clearance.models.run_folder.Path",
        "clearance.models.trusted.instantiate",
        "clearance.whole_files.write_json",
        "clearance.recording.files.write",
        "hydra.utils.get_method",
        "torch.nn.modules.module.torch.load",
        "torch.load",
        "torch.nn.init.ones_",
        "${oc.env:HOME}",
        7,
    ],
)
def test_a_run_folder_cannot_name_code_to_run(target):
    with pytest.raises(InputError, match="only this project's own classes"):
        instantiate_trusted({"net": [{"_target_": target}]}, "config.yaml")


def test_our_own_classes_are_built():
    config = {
        "_target_": "clearance.models.tcn.TemporalConvolutions",
        "channels": 2,
        "length": 50,
        "outputs": 1,
        "widths": [4],
    }
    assert type(instantiate_trusted(config, "config.yaml")).__name__ == "TemporalConvolutions"
    assert instantiate_trusted({"_target_": "torch.nn.L1Loss"}, "config.yaml").reduction == "mean"
