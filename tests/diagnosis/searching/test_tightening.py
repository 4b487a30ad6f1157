"""Beside a near path hypotheses are fitted on it, and followed anew where that says nothing of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import search as module
from clearance.diagnosis.searching.search import Search

BASE = SimpleNamespace(scale=1.0, misfit=3.0, followers=[])
HINTED, FITTED = np.array([[3e-4, 5.0, 700.0]]), np.array([[3e-4, 6.0, 700.0]])


@pytest.mark.parametrize(
    ("misfit", "begun"),
    [
        (1.0, None),  # it explains
        (2.9, None),  # it hardly helps
        (1.5, FITTED),
        (17.8, HINTED),  # the path is torn: at their minimum more unknowns leave no more
    ],
)
def test_a_fit_that_leaves_more_than_without_its_unknowns_is_followed_anew_from_the_hint(
    monkeypatch, misfit, begun
):
    fit = SimpleNamespace(values=FITTED)
    found = SimpleNamespace(scale=1.0, level=misfit, misfit=misfit, misfits=[misfit], fit=fit)
    monkeypatch.setattr(module, "refine", lambda *_: found)
    asked = []
    search = SimpleNamespace(
        setting=SimpleNamespace(model=lambda held: None), workers=1,
        follow_anew=lambda held, base, values, limit, found: asked.append(values) or "anew",
    )  # fmt: skip
    result = Search.tighten(search, [], BASE, HINTED, 3.0)
    assert result == (found if begun is None else "anew")
    assert [one is begun for one in asked] == ([] if begun is None else [True])
