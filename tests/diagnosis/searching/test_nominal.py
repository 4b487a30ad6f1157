"""What is tried anew from another clearance leaves nothing behind unless it is better."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following.finished import Finished
from clearance.diagnosis.searching import nominal
from clearance.diagnosis.searching.explanation import Explanation
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


@pytest.mark.parametrize(
    ("level", "expected"), [(1.0, [1.0, 0.975, 1.025, 0.95]), (40.0, list(nominal._PATIENTLY))]
)
def test_a_lost_nominal_machine_counts_where_it_explains_all_at_another_clearance(
    monkeypatch, level, expected
):
    sought, here = [], SimpleNamespace(doubt=1.0)

    def grow(start, model, row, most):
        sought.append(row[0] / 8e-4)
        return (None, row, 0.9) if row[0] < 0.96 * 8e-4 else (None, row, 50.0)

    fit = SimpleNamespace(values=np.array([[0.95 * 8e-4, 70.0]]))
    found = SimpleNamespace(misfit=level, misfits=[level], level=level, scale=1.0, fit=fit)
    monkeypatch.setattr(nominal, "grow", grow)
    monkeypatch.setattr(nominal, "screen", lambda *_: SimpleNamespace(singles=["a hint"]))
    moved = []
    search = SimpleNamespace(
        recordings=[SimpleNamespace(raw=None)], starts=[here], traces=[SimpleNamespace(speed=70.0)],
        clearance=8e-4, workers=1,
        setting=SimpleNamespace(model=lambda: None), sought=lambda *_: here, late=lambda: False,
        grown=lambda hypotheses, values, starts: found, retrace_all=moved.append, others=lambda _: [],
        report=lambda _: None, finished=Finished(None, [], print), begin=lambda *_: ["begun anew"],
    )  # fmt: skip
    explanation = Explanation(SimpleNamespace(misfit=600.0))
    nominal.find_nominal(search, explanation)
    assert sought == pytest.approx(expected)
    assert (explanation.nominal is found) == (level < 1.35)
    assert explanation.hints == (["a hint"] if level < 1.35 else [])
    assert moved == pytest.approx([0.95 * 8e-4] if level < 1.35 else [])
    assert search.starts == (["begun anew"] if level < 1.35 else [here])
