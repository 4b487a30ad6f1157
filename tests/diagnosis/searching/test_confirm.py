"""What explains is followed again on paths of its own, with all that explains as well."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.searching.confirm import confirm
from clearance.diagnosis.searching.explanation import Explanation
from tests.diagnosis.judging.test_verdict import attempt as found


def attempt(names, misfit):
    one = found(names, misfit)
    for hypothesis in one.hypotheses:
        hypothesis.structural = lambda _: False
    one.label = " + ".join(names)
    one.fit.values = np.zeros((1, 1))
    return one


def confirmed(monkeypatch, attempts, following, late=False):
    """The best misfit, rounds and what is refitted where following anew gives these, one after another."""
    explanation, refitted, left = Explanation(attempt([], 9.0), list(attempts)), [], list(following)

    def again(_, explanation, though_explained):
        assert though_explained
        explanation.attempts.append(attempt(["rod_inertia"], left.pop(0)))

    monkeypatch.setattr("clearance.diagnosis.searching.confirm.begin_again", again)
    search = SimpleNamespace(
        late=lambda: late,
        refit=lambda _, held, *__, **___: refitted.append(held[0].name),
        setting=SimpleNamespace(with_clearance=lambda _: None),
    )
    confirm(search, explanation)
    return explanation.best.misfit, len(following) - len(left), refitted


@pytest.mark.parametrize(
    ("following", "best", "rounds"),
    [
        ([1.05, 1.0], 1.0, 1),  # no less: it was in its minimum
        ([0.95, 0.94, 0.93, 0.92], 0.93, 3),  # each time nearer
        ([0.998, 0.9], 0.998, 1),  # hardly less
    ],
)
def test_a_named_effect_is_followed_anew_as_long_as_it_leaves_less(monkeypatch, following, best, rounds):
    assert confirmed(monkeypatch, [attempt(["rod_inertia"], 1.0)], following)[:2] == (best, rounds)


def test_what_explains_as_well_is_fitted_on_the_better_paths_too(monkeypatch):
    alike, worse = attempt(["torque_ripple"], 1.001), attempt(["gravity"], 1.3)
    attempts = [attempt(["rod_inertia"], 1.0), alike, worse]
    assert confirmed(monkeypatch, attempts, [0.95, 0.96])[2] == ["torque_ripple"]


@pytest.mark.parametrize(
    ("best", "late"), [(attempt([FREE_FORM], 1.0), False), (attempt(["gravity"], 1.9), False),
                       (attempt(["gravity"], 1.0), True)]
)  # fmt: skip
def test_no_table_nothing_that_does_not_explain_and_nothing_late_is_followed_anew(monkeypatch, best, late):
    assert confirmed(monkeypatch, [best], [0.5], late)[1] == 0
