"""The README's picture tells which intervals hold, and draws what is far off at its edge."""

import numpy as np

from clearance.evaluation.overview import overview


def test_intervals_that_hold_are_told_from_those_that_do_not(tmp_path):
    truth = np.linspace(0.0, 1e-3, 40)
    estimate = truth + 1e-6
    estimate[3] += 4e-4  # far outside of the picture
    wide = np.where(np.arange(40) < 30, 2e-6, 0.5e-6)
    joint = {
        "truth": truth, "estimate": estimate, "low": estimate - wide, "high": estimate + wide,
        "summary": {"recordings": 40},
    }  # fmt: skip
    figure = overview([joint], "a model")
    figure.savefig(tmp_path / "a.png")
    axes = figure.axes[2]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "true value inside: 29",
        "outside: 11",
    ]
    low, high = axes.get_ylim()
    drawn = np.concatenate([container[0].get_ydata() for container in axes.containers])
    assert len(drawn) == 40
    assert low < drawn.min() <= drawn.max() < high < 20.0  # um
