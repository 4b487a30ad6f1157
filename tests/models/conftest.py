from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from clearance.models.run_folder import RunFolder
from clearance.windows.datamodule import WindowData
from clearance.windows.splitting import RandomSplit
from clearance.windows.windowing import RegularWindows

CONF = Path(__file__).parents[2] / "conf"
# Small enough for a test: every file of conf/model has a line here.
SMALL = {
    "lstm": ["model.net.hidden_size=16", "model.net.fold=4"],
    "gru": ["model.net.hidden_size=16", "model.net.fold=4"],
    "tdnn": ["model.net.filters=8"],
    "tdnn_flatten": ["model.net.filters=8"],
    "tdnn_average": ["model.net.filters=8"],
    "tdnn_max": ["model.net.filters=8"],
    "tcn": ["model.net.stem=8", "model.net.widths=[8,8]"],
    "random_forest": ["model.trees=5", "model.jobs=1"],
    "xgboost": ["model.rounds=20", "model.depth=4", "model.learning_rate=0.3"],
}
NEURAL = [name for name in SMALL if name not in ("random_forest", "xgboost")]


def configured(model, *overrides):
    """The model that the command line would make."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        chosen = [f"model={model}", "experiment=smoke", "trainer.accelerator=cpu", "trainer.threads=1"]
        cfg = compose("train", [*chosen, *SMALL[model], *overrides])
    return instantiate(cfg.model)


@pytest.fixture
def make_data(chirps):
    def make(runs=20, samples=300, length=60, source=None, batch_size=16, targets=("clearance_c",)):
        data = WindowData(
            source or chirps(runs, samples), ("a", "b"), targets, RandomSplit(42),
            RegularWindows(length, length), batch_size=batch_size,
        )  # fmt: skip
        data.setup()
        return data

    return make


@pytest.fixture
def open_run(tmp_path):
    def begun(name="run", seed=42):
        run = RunFolder.open(tmp_path / name, {"seed": seed}, seed)
        run.begin("chirps")
        return run

    return begun
