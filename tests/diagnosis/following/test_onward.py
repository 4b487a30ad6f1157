"""What was held out is followed from where the fitted stretch of the same recording ends."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following import onward
from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.following.onward import best_of, go_on, together, ways_to_follow
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.simulation.layout import State
from tests.diagnosis.shooting.test_follow import MODEL, RPM, SEGMENTS, TRUTH, follower

FITTED, HELD = 30, 12  # segments at the beginning, and at the end


class Part:
    """A trace's own recording, and how much of it is wanted."""

    def __init__(self, measured):
        self.measured, self.length = measured, len(measured.values)


def attempt_on(measured):
    one = follower().part(0, FITTED)
    one.measured = measured
    found = fit([one], MODEL, TRUTH, 4, 1e-5, 1)
    return Attempt((), MODEL, found, 1.0, found.level, [one])


def only_speed(clearance=TRUTH[0, 0]):
    return Model((Unknown("speed", 1e-3, own=True),), lambda v: MODEL.machine(np.array([clearance, v[-1]])))


def test_a_path_goes_on_through_what_lies_between():
    whole = follower()
    attempt = attempt_on(whole.measured.part(0, FITTED))
    rest = whole.measured.part(SEGMENTS - HELD, SEGMENTS)
    found = go_on(attempt, Part(rest), only_speed(attempt.fit.values[0, 0]), np.inf)
    assert found is not None
    own, row, misfit = found
    assert (own.measured.first, own.segments) == (SEGMENTS - HELD, HELD)
    assert misfit == pytest.approx(1.0, abs=0.2)  # of 640 samples
    assert row[0] == pytest.approx(RPM, rel=1e-3)
    error = np.abs(own.path.nodes - whole.path.nodes[-HELD:])[2:-2]
    assert error[:, State.CRANK_ANGLE].max() < 1e-3
    assert error[:, State.CRANK_SPEED].max() < 0.1


@pytest.mark.parametrize(
    ("lost", "kept"),
    [(range(0), (0, SEGMENTS)), (range(8), (8, SEGMENTS - 2)), (range(20, 23), (0, SEGMENTS))],
    ids=["nowhere", "at the beginning", "in the middle"],
)
def test_of_a_path_that_is_found_again_the_longest_stretch_counts_if_it_is_most(monkeypatch, lost, kept):
    monkeypatch.setattr(onward, "_MOST", 0.8)
    path = follower()
    path.path.nodes[list(lost), State.CRANK_ANGLE] += 0.3
    part, _, misfit = onward._longest(path, only_speed(), np.array([RPM]))
    first, last = kept
    assert (part.measured.first, part.segments) == (
        pytest.approx(first, abs=3), pytest.approx(last - first, abs=3)
    )  # fmt: skip
    assert misfit == pytest.approx(1.0, abs=0.2)


def test_another_recording_is_not_gone_on_to():
    whole = follower()
    attempt = attempt_on(whole.measured.part(0, FITTED))
    other = replace(whole.measured.part(SEGMENTS - HELD, SEGMENTS), name="another")
    earlier = whole.measured.part(FITTED - 5, SEGMENTS)
    for part in (other, earlier):
        assert go_on(attempt, Part(part), only_speed(attempt.fit.values[0, 0]), np.inf) is None


@pytest.mark.parametrize(
    ("misfits", "asked", "expected"),
    [([1.0, 9.0], 1, 1.0), ([40.0, 7.0, 1.1, 1.0], 3, 1.1), ([40.0, 7.0, 9.0], 3, 7.0)],
)
def test_a_recording_is_followed_on_other_ways_until_it_is_explained(monkeypatch, misfits, asked, expected):
    given = []

    def ways():
        yield None  # no way from the fitted stretch
        for misfit in misfits:
            given.append(misfit)
            yield "follower", np.array([RPM]), misfit

    def refined(hypotheses, model, followers, rows, scale, iterations):
        return SimpleNamespace(misfit=given[-1], scale=1.0, level=given[-1])

    monkeypatch.setattr(onward, "refine", refined)
    assert best_of(ways(), None).misfit == expected
    assert len(given) == asked


@pytest.mark.parametrize(("patience", "count"), [(0, 1), (40, 5)])
def test_without_patience_there_is_one_way(monkeypatch, patience, count):
    starts = SimpleNamespace(of=lambda *_: "surest", several=lambda *_: list("abcd"))
    monkeypatch.setattr(onward, "Start", starts)
    monkeypatch.setattr(onward, "grow", lambda start, model, row, **how: (start, row, float(how["patient"])))
    model = SimpleNamespace(held=lambda row: row)
    found = list(ways_to_follow(None, model, np.array([RPM]), patience, np.inf))
    assert [one[0] for one in found] == ["surest", *"abcd"][:count]


def test_beside_one_that_is_explained_all_recordings_are_looked_at_without_annealing():
    model, rows = only_speed(), np.array([[RPM]])
    good, bad = follower(), follower()
    bad.path.nodes[:, State.CRANK_ANGLE] += 0.02

    def one(path, scale):
        found = fit([path], model, rows, 0, 1.0, 1, scale=scale)
        return Attempt((), model, found, scale, found.level, [path])

    joined = together([one(good, 1.0), one(bad, 10.0)], 1)
    assert joined.scale == 1.0
    assert joined.misfits[0] == pytest.approx(1.0, abs=0.2)
    assert joined.misfits[1] > 5.0
    assert together([one(bad, 10.0), one(bad, 3.16)], 1).scale == 10.0


def test_what_comes_long_after_the_fitted_stretch_is_not_gone_on_to(monkeypatch):
    whole = follower()
    attempt = attempt_on(whole.measured.part(0, FITTED))
    rest = whole.measured.part(SEGMENTS - HELD, SEGMENTS)
    monkeypatch.setattr(onward, "_FURTHEST", SEGMENTS - HELD - FITTED - 1)
    assert go_on(attempt, Part(rest), only_speed(attempt.fit.values[0, 0]), np.inf) is None
