"""What was held out is followed from where the fitted stretch of the same recording ends."""

import time
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following import onward
from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.following.onward import Way, best_of, go_on, together, ways_to_follow
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.errors import InputError
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
    own = found.follower
    assert (own.measured.first, own.segments) == (SEGMENTS - HELD, HELD)
    assert found.misfit == pytest.approx(1.0, abs=0.2)  # of 640 samples
    assert found.row[0] == pytest.approx(RPM, rel=1e-3)
    assert found.share == 1.0
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
    way = onward._longest(path, only_speed(), np.array([RPM]))
    first, last = kept
    assert (way.follower.measured.first, way.follower.segments) == (
        pytest.approx(first, abs=3), pytest.approx(last - first, abs=3)
    )  # fmt: skip
    assert way.share == way.follower.segments / SEGMENTS
    assert way.misfit == pytest.approx(1.0, abs=0.2)


def test_another_recording_is_not_gone_on_to():
    whole = follower()
    attempt = attempt_on(whole.measured.part(0, FITTED))
    other = replace(whole.measured.part(SEGMENTS - HELD, SEGMENTS), name="another")
    earlier = whole.measured.part(FITTED - 5, SEGMENTS)
    for part in (other, earlier):
        assert go_on(attempt, Part(part), only_speed(attempt.fit.values[0, 0]), np.inf) is None


@pytest.mark.parametrize(
    ("ways", "seconds", "asked", "expected"),
    [
        ([1.0, 9.0], 60.0, 1, (1.0, ())),
        ([40.0, 7.0, 1.1, 1.0], 60.0, 3, (1.1, ())),
        ([40.0, None, 7.0, 9.0], 60.0, 4, (7.0, ())),
        ([40.0, 7.0], -1.0, 1, (40.0, ())),  # in a hurry
        ([None, 7.0], -1.0, 2, (7.0, ())),  # but something is followed
        ([InputError("no law"), 7.0], 60.0, 2, (7.0, ())),
        ([(1.0, 0.6), 9.0, 1.2], 60.0, 3, (1.2, ())),  # the whole is better than a part
        ([(1.0, 0.6), 9.0], 60.0, 2, (1.0, (0.6,))),
    ],
)
def test_a_recording_is_followed_on_other_ways_until_it_is_explained(
    monkeypatch, ways, seconds, asked, expected
):
    given = []

    def way(left):
        given.append(left)
        if isinstance(left, Exception):
            raise left
        misfit, share = left if isinstance(left, tuple) else (left, 1.0)
        return None if left is None else Way("follower", np.array([RPM]), misfit, share)

    def refined(hypotheses, model, followers, rows, scale, iterations):
        misfit = given[-1][0] if isinstance(given[-1], tuple) else given[-1]
        return SimpleNamespace(misfit=misfit, scale=1.0, level=misfit, misfits=[misfit], shares=())

    monkeypatch.setattr(onward, "refine", refined)
    found = best_of((partial(way, left) for left in ways), None, time.monotonic() + seconds)
    assert (found.misfit, found.shares) == expected
    assert len(given) == asked


def test_what_no_law_takes_on_any_way_is_an_error():
    def way():
        raise InputError("no law takes that")

    with pytest.raises(InputError, match="no law takes that"):
        best_of([way, way], None, np.inf)


@pytest.mark.parametrize(
    ("patience", "seconds", "expected"),
    [(0, 60.0, "S0"), (40, 60.0, "S40 a c d -"), (40, -1.0, "S0 a c d -")],
)
def test_without_patience_there_is_one_way_and_no_place_is_tried_twice(
    monkeypatch, patience, seconds, expected
):
    def start(label):
        return SimpleNamespace(label=label, island="b" if label[0] == "S" else label)

    starts = SimpleNamespace(
        of=lambda trace, held, looseness, patience: start(f"S{patience}"),
        several=lambda *_: [start(label) for label in "abcd"],
    )
    monkeypatch.setattr(onward, "Start", starts)
    monkeypatch.setattr(onward, "grow", lambda start, model, row, **how: (start.label, row, 1.0))
    model = SimpleNamespace(held=lambda row: row)
    ways = ways_to_follow(None, model, np.array([RPM]), patience, time.monotonic() + seconds)
    found = [way() for way in ways]
    assert " ".join("-" if one is None else one.follower for one in found) == expected


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
    assert joined.shares == ()
    assert together([one(bad, 10.0), one(bad, 3.16)], 1).scale == 10.0
    part = one(good, 1.0)
    part.shares = (0.6,)
    assert together([part, one(follower(), 1.0)], 1).shares == (0.6, 1.0)


def test_what_comes_long_after_the_fitted_stretch_is_not_gone_on_to(monkeypatch):
    whole = follower()
    attempt = attempt_on(whole.measured.part(0, FITTED))
    rest = whole.measured.part(SEGMENTS - HELD, SEGMENTS)
    monkeypatch.setattr(onward, "_FURTHEST", SEGMENTS - HELD - FITTED - 1)
    assert go_on(attempt, Part(rest), only_speed(attempt.fit.values[0, 0]), np.inf) is None
