"""What stands in for the steps of the course, whose order is tested."""

import numpy as np
import pytest

from clearance.diagnosis.searching import building, course
from clearance.diagnosis.searching.widen import Prospects


@pytest.fixture
def stand_in(monkeypatch):
    """Returns what puts something in the place of a function, in the search and in what it builds on."""

    def put(name, instead):
        users = [module for module in (course, building) if hasattr(module, name)]
        assert users, name
        for module in users:
            monkeypatch.setattr(module, name, instead)

    return put


@pytest.fixture
def still(stand_in):
    """Nothing shakes the frame, one clearance, no rails, no force that the balance names, nothing lost."""
    for name in (
        "begin_frame",
        "begin_beside",
        "begin_displaced_paths",
        "begin_guide",
        "begin_patiently",
        "find_nominal",
    ):
        stand_in(name, lambda *_, **__: None)


@pytest.fixture
def fruitless(stand_in):
    """Every step finds nothing; returns ``stand_in``."""
    for name in (
        "glaring", "enlarge", "reshape", "reshape_anew", "begin_elsewhere", "begin_again", "begin_inside",
        "begin_clock", "begin_dimensions", "begin_displaced", "begin_wear", "begin_plausible", "widen",
        "fit_curve",
    ):  # fmt: skip
        stand_in(name, lambda *_, **__: None)
    for name in ("begin_balanced", "begin_pairs"):
        stand_in(name, lambda *_: [])
    stand_in("suggest_channels", lambda _: {})
    stand_in("suggest_dimensions", lambda *_: [])
    stand_in("suggest_curve", lambda *_: ([], np.inf))
    prospects = Prospects([], [], [], [], [])
    stand_in("look", lambda *_: prospects)
    return stand_in
