"""What was held out is followed from where the fitted stretch of the same recording ends."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following import onward
from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.following.onward import follow_again, go_on
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.model import Model, Unknown
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


def only_speed(attempt):
    clearance = attempt.fit.values[0, 0]
    return Model((Unknown("speed", 1e-3, own=True),), lambda v: MODEL.machine(np.array([clearance, v[-1]])))


def test_a_path_goes_on_through_what_lies_between():
    whole = follower()
    attempt = attempt_on(whole.measured.part(0, FITTED))
    rest = whole.measured.part(SEGMENTS - HELD, SEGMENTS)
    found = go_on(attempt, [Part(rest)], only_speed(attempt), 1)
    assert found is not None
    (own,) = found.followers
    assert (own.measured.first, own.segments) == (SEGMENTS - HELD, HELD)
    assert found.scale == 1.0
    assert found.misfit == pytest.approx(1.0, abs=0.2)  # of 640 samples
    assert found.fit.values[0, 0] == pytest.approx(RPM, rel=1e-3)
    error = np.abs(own.path.nodes - whole.path.nodes[-HELD:])[2:-2, :2]
    assert error.max() < 1e-3


def test_another_recording_is_not_gone_on_to():
    whole = follower()
    attempt = attempt_on(whole.measured.part(0, FITTED))
    other = replace(whole.measured.part(SEGMENTS - HELD, SEGMENTS), name="another")
    earlier = whole.measured.part(FITTED - 5, SEGMENTS)
    for part in (other, earlier):
        assert go_on(attempt, [Part(part)], only_speed(attempt), 1) is None


@pytest.mark.parametrize(
    ("misfits", "late", "tried"),
    [
        ([1.0, 40.0, 1.0], False, [40.0, 7.0, 1.1]),
        ([1.0, 40.0, 1.0], True, [7.0]),
        ([1.0, 1.2, 1.0], False, []),
        ([1.0, 0.9, 40.0], False, []),
    ],
)
def test_only_what_was_lost_is_followed_from_other_places_until_one_follows(
    monkeypatch, misfits, late, tried
):
    asked, ends = [], iter([7.0] if late else [40.0, 7.0, 1.1, 1.0])

    def again():
        return follow_again(lost, [None] * 3, SimpleNamespace(held=lambda row: row), 1, lambda: late)

    def grow(start, model, row, patient):
        asked.append(next(ends))
        return start, row, asked[-1]

    monkeypatch.setattr(
        onward, "Start", SimpleNamespace(several=lambda *asked_for: list("abcd")[: asked_for[-1]])
    )
    monkeypatch.setattr(onward, "grow", grow)
    monkeypatch.setattr(
        onward, "refine", lambda _, model, followers, rows, scale, *more: SimpleNamespace(
            misfit=1.0 + scale, followers=followers
        )
    )  # fmt: skip
    values = SimpleNamespace(values=np.ones((3, 1)))
    lost = SimpleNamespace(misfit=np.mean(misfits), misfits=misfits, followers=["x", "y", "z"], fit=values)
    if misfits[2] > 1.35:  # no place is better
        ends = iter([50.0] * 4)
        assert again() is lost
        return
    found = again()
    assert asked == tried
    assert (found is lost) == (not tried)
    if tried:
        assert found.followers == ["x", "a" if late else "c", "z"]


def test_what_comes_long_after_the_fitted_stretch_is_not_gone_on_to(monkeypatch):
    whole = follower()
    attempt = attempt_on(whole.measured.part(0, FITTED))
    rest = whole.measured.part(SEGMENTS - HELD, SEGMENTS)
    monkeypatch.setattr(onward, "_FURTHEST", SEGMENTS - HELD - FITTED - 1)
    assert go_on(attempt, [Part(rest)], only_speed(attempt), 1) is None
