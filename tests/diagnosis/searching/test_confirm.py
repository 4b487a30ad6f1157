"""What explains is followed again on paths of its own, with all that explains as well."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.searching.confirm import confirm
from clearance.diagnosis.searching.elsewhere import begin_again
from clearance.diagnosis.searching.explanation import Explanation
from tests.diagnosis.attempts import attempt as found


def attempt(names, misfit, structural=False, body="slider"):
    one = found(names, misfit)
    for hypothesis in one.hypotheses:
        hypothesis.structural, hypothesis.body = lambda _: structural, body
    one.label = " + ".join(names)
    one.fit.values = np.zeros((1, 1))
    return one


def confirmed(monkeypatch, attempts, following, late=False, nominal=9.0, at_last=False):
    """The best misfit, rounds and what is refitted where following anew gives these, one after another."""
    refitted, left = [], list(following)
    explanation = Explanation(attempt([], nominal), list(attempts))

    def again(_, explanation, though_explained):
        assert though_explained
        explanation.attempts.append(attempt(["rod_inertia"], left.pop(0)))

    monkeypatch.setattr("clearance.diagnosis.searching.confirm.begin_again", again)
    search = SimpleNamespace(
        late=lambda: late,
        refit=lambda _, held, *__, **___: refitted.append(held[0].name),
        setting=SimpleNamespace(with_clearance=lambda _: None),
    )
    confirm(search, explanation, at_last)
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


def test_names_that_explain_as_well_are_fitted_on_the_better_paths_too(monkeypatch):
    alike, worse = attempt(["torque_ripple"], 1.001), attempt(["gravity"], 1.3)
    table, bending = attempt([FREE_FORM], 1.001), attempt(["rod_flexibility"], 1.001, structural=True)
    attempts = [attempt(["rod_inertia"], 1.0), alike, worse, table, bending]
    assert confirmed(monkeypatch, attempts, [0.95, 0.96])[2] == ["torque_ripple"]


@pytest.mark.parametrize(
    ("best", "late", "nominal"),
    [
        (attempt([FREE_FORM], 1.0), False, 9.0),
        (attempt(["guide_clearance"], 1.0), False, 9.0),
        (attempt(["gravity"], 1.9), False, 9.0),  # it does not explain
        (attempt(["gravity"], 1.25), False, 9.0),  # something else is missing, too
        (attempt(["gravity"], 1.0), True, 9.0),
        (attempt(["gravity"], 1.0), False, 1.1),  # the paths are right but for little
    ],
)
def test_what_else_is_not_followed_anew(monkeypatch, best, late, nominal):
    assert confirmed(monkeypatch, [best], [0.5], late, nominal)[1] == 0


def test_what_leaves_more_than_right_effects_do_is_followed_anew_at_last(monkeypatch):
    best = [attempt(["gravity"], 1.25)]
    assert confirmed(monkeypatch, best, [1.0, 1.0], at_last=True)[:2] == (1.0, 2)


def test_what_acts_inside_the_joint_is_followed_anew_though_the_nominal_machine_explains(monkeypatch):
    best = [attempt(["contact_stiffness"], 1.03, body="joint_c")]
    assert confirmed(monkeypatch, best, [0.95], nominal=1.08)[:2] == (0.95, 1)


@pytest.mark.parametrize("though_explained", [False, True])
def test_what_explains_is_fitted_again_where_that_is_asked_for(though_explained):
    kept = []
    nothing, nominal = nullcontext(), attempt([], 9.0)
    search = SimpleNamespace(
        starts=[SimpleNamespace(doubt=1.0)], timed=lambda _: nothing,
        keep=lambda _, held, make, again: kept.append((held[0].name, again)),
    )  # fmt: skip
    begin_again(search, Explanation(nominal, [attempt(["gravity"], 1.0)]), though_explained)
    assert kept == [("gravity", though_explained)]
