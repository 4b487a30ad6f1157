"""Figures 7 to 9: true against predicted clearances of the test windows, one panel a model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from clearance.evaluation.figures import new_figure, scatter_against_true
from clearance.evaluation.paper.perturbation import TrainingData, estimate
from clearance.evaluation.paper.trainings import Finished, Setting, Training
from clearance.models.gauge import Gauge
from clearance.models.run_folder import CONFIG
from clearance.models.trusted import instantiate_trusted

NAMES = {
    "random_forest": "Random forest", "xgboost": "XGBoost", "tdnn": "TDNN", "lstm": "LSTM", "gru": "GRU",
    "tcn": "TCN", "tdnn_flatten": "TDNN, flattened", "tdnn_max": "TDNN, maximum",
    "tdnn_average": "TDNN, average",
}  # fmt: skip


@dataclass(frozen=True)
class PredictedAgainstTrue:
    """One training of each model.

    Attributes:
        models: by name of their option.
        joint: B or C.
        split_seed: of the trainings.
        seed: of their initial weights.
    """

    models: Sequence[str]
    joint: str
    split_seed: int
    seed: int

    def draw(self, found: Mapping[Training, Finished]) -> Figure | None:
        """A panel a finished training; ``None`` if there is none, or one whose weights are not here."""
        wanted = {m: Training(Setting(m, joint=self.joint), self.split_seed, self.seed) for m in self.models}
        runs = {model: found[key] for model, key in wanted.items() if key in found}
        if not runs or any(run.path is None or not any(run.path.glob("model.*")) for run in runs.values()):
            return None
        figure = new_figure(4.2 * len(runs), 4.3)
        panels = np.atleast_1d(figure.subplots(1, len(runs), sharex=True, sharey=True))
        for axes, (model, run) in zip(panels, runs.items(), strict=True):
            assert run.path is not None
            where = str(run.path / CONFIG)
            gauge = Gauge.load(instantiate_trusted(dict(run.config["model"]), where), run.path)
            values, truth = estimate(gauge, TrainingData.of(run.path).test())
            scatter_against_true(axes, values, truth)
            axes.set(title=f"{NAMES.get(model, model)}: NMAE {run.metrics['test']['nmae']:.2f} %")
            axes.label_outer()
        return figure
