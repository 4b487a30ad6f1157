import numpy as np
import torch

from clearance.evaluation.figures import error_against_clearance_and_speed, predicted_against_true
from clearance.evaluation.metrics import paper_metrics


def test_metrics_are_the_papers_equations_whatever_the_batches():
    rng = np.random.default_rng(0)
    truth = rng.uniform(0, 1e-3, 1001)
    estimate = truth + rng.normal(0, 2e-5, 1001)
    error = np.abs(estimate - truth)
    metrics = paper_metrics()
    for part in np.array_split(np.arange(1001), 7):
        metrics.update(torch.from_numpy(estimate[part]), torch.from_numpy(truth[part]))
    result = {name: float(value) for name, value in metrics.compute().items()}
    expected = {
        "nmae": 100 * error.mean() / 1e-3,
        "nrmse": 100 * np.sqrt(np.mean(error**2)) / 1e-3,
        "median_ae": np.median(error),
        "p95_ae": np.percentile(error, 95),
    }
    assert result.keys() == expected.keys()
    for name, value in expected.items():
        assert np.isclose(result[name], value, rtol=1e-12), name


def test_another_range_normalises_otherwise():
    truth, estimate = torch.tensor([1e-4]), torch.tensor([2e-4])
    one, half = paper_metrics(1e-3), paper_metrics(5e-4)
    one.update(estimate, truth)
    half.update(estimate, truth)
    assert np.isclose(2 * float(one.compute()["nmae"]), float(half.compute()["nmae"]))


def test_one_window_has_a_median():
    metrics = paper_metrics()
    metrics.update(torch.tensor([3e-4]), torch.tensor([1e-4]))
    assert np.isclose(float(metrics.compute()["median_ae"]), 2e-4)


def test_pictures_show_every_window_with_units():
    rng = np.random.default_rng(0)
    truth, speed = rng.uniform(0, 1e-3, 200), rng.uniform(52, 105, 200)
    speed[:5] = np.nan  # unknown for measured recordings
    estimate = truth + rng.normal(0, 1e-5, 200)
    figure = predicted_against_true(estimate, truth, "lstm on rod")
    axes = figure.axes[0]
    points = axes.collections[0].get_offsets()
    assert np.allclose(points, np.column_stack([truth, estimate]) * 1e3)
    assert axes.get_title() == "lstm on rod"
    figure = error_against_clearance_and_speed(estimate, truth, speed, "lstm on rod")
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert labels == ["true clearance [mm]", "crank speed [rpm]"]
    assert len(figure.axes[1].collections[0].get_offsets()) == 195
    figure.canvas.draw()
