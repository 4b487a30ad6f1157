"""What is tried anew from another clearance leaves nothing behind unless it is better."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following.finished import Finished
from clearance.diagnosis.searching import nominal
from clearance.diagnosis.searching.search import Search

TOLD, RECORDED = SimpleNamespace(raw=1.0, name="as told"), SimpleNamespace(raw=1.0, name="as recorded")


@pytest.mark.parametrize(("misfit", "kept"), [(30.0, RECORDED), (15.0, TOLD)])
def test_a_second_attempt_that_is_no_better_is_undone_for_fits_that_are_recalled_too(
    monkeypatch, misfit, kept
):
    search = Search.__new__(Search)
    search.finished = Finished(None, [RECORDED], print)
    search.recordings, search.clearance, search.traces, search.starts = [RECORDED], 1e-4, ["own"], ["own"]
    search.deadline, search.stopped = np.inf, ""

    def refitted(search):
        anew = search.clearance != 1e-4
        if anew:
            search.hear([TOLD])
        fit = SimpleNamespace(values=np.array([[2e-4, 70.0]]))
        return SimpleNamespace(nominal=SimpleNamespace(fit=fit, misfit=misfit if anew else 20.0))

    def retrace_all(clearance):
        search.clearance, search.traces = clearance, ["another"]

    monkeypatch.setattr(search, "retrace_all", retrace_all)
    monkeypatch.setattr(nominal, "_refitted", refitted)
    explanation = nominal.refit_nominal(search)

    assert explanation.nominal.misfit == min(misfit, 20.0)
    assert (search.clearance == 1e-4) == (kept is RECORDED)
    assert search.recordings == [kept]
    assert search.finished.recordings == [kept]
