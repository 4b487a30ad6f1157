"""Fits to all recordings from what one of them, or the motion, suggests."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import everywhere
from clearance.diagnosis.searching.everywhere import between, fit_everywhere
from clearance.errors import InputError
from tests.diagnosis.attempts import attempt


def search_with(grown, recordings=1):
    """A search that follows as it is told, from anywhere."""
    start = SimpleNamespace(trace=SimpleNamespace(speed=70.0), doubt=1.0)
    return SimpleNamespace(
        setting=SimpleNamespace(model=lambda held: None), workers=1, starts=[start] * recordings, grown=grown,
        profile=SimpleNamespace(best=3e-4), sought=lambda *_: start,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "clearance", "expected"),
    [
        ("slider_spring", 6.1e-4, 6.1e-4),  # with which the motion agrees beside the spring
        ("slider_spring", None, 3e-4),  # with which the nominal machine's motion agrees
        ("slider_offset", None, 11e-4),  # which misleads that
        ("slider_offset", 6.1e-4, 6.1e-4),
        ("slider_spring", 10e-4, 11e-4),  # that is about the same
    ],
)
def test_a_clearance_that_was_led_astray_is_begun_again_where_the_motion_agrees(
    monkeypatch, name, clearance, expected
):
    begun, left = [], iter([7.0, 1.0])

    def grown(held, values, starts, base, insist):
        begun.append(values[0, 0])
        found = attempt([name], next(left))
        found.fit.values = np.array([[11e-4, 835.0, 70.0]])
        return found

    search = search_with(grown)
    held, row = attempt([name], 1.0).hypotheses, np.array([5e-4, 841.0, 70.0])
    held[0].fault = None
    found = fit_everywhere(search, held, row, 0, attempt([], 122.0), anew=True, clearance=clearance)
    assert begun == pytest.approx([5e-4, expected])
    assert found.misfit == 1.0


@pytest.mark.parametrize(
    ("each", "before", "expected"),
    [
        ([1.0, 90.0], 100.0, [3e-4, 3.1e-4]),  # one is followed, and tells more alone
        ([20.0, 90.0], 100.0, [3e-4, 3.1e-4]),  # or nearly
        ([60.0, 90.0], 100.0, [3e-4]),  # neither is
        ([1.0, 90.0], 1.1, [3e-4]),  # it was before, and tells nothing of what is new
        ([1.0, 1.1], 100.0, [3e-4]),
    ],
)
def test_a_recording_that_is_lost_is_looked_for_again_with_what_another_one_tells_alone(
    monkeypatch, each, before, expected
):
    first = attempt(["worn_bearing"], float(np.mean(each)), each=each)
    begun, found = [], [first, attempt(["worn_bearing"], 1.0, each=[1.0, 1.0])]
    for one, clearance in zip(found, (2.8e-4, 3.1e-4), strict=True):
        one.fit.values = np.array([[clearance, 8e-5, 700.0]] * 2)

    def grown(held, values, starts, base, insist):
        begun.append(values[0, 0])
        return found[len(begun) - 1]

    def refine(hypotheses, model, followers, rows, *_):
        assert [f.measured.name for f in followers] == ["0.csv"]
        return SimpleNamespace(fit=SimpleNamespace(values=np.array([[3.1e-4, 8.3e-5, 700.0]])))

    monkeypatch.setattr(everywhere, "refine", refine)
    search = search_with(grown, recordings=2)
    held, base = attempt(["worn_bearing"], 1.0).hypotheses, attempt([], 100.0, each=[before, 100.0])
    fit_everywhere(search, held, np.array([3e-4, 6e-5, 700.0]), 0, base, anew=True)
    assert begun == pytest.approx(expected)


def test_what_an_earlier_look_has_found_stands_where_a_later_one_fails(monkeypatch):
    first = attempt(["worn_bearing"], 5.0, each=[5.0])
    first.fit.values = np.array([[3e-4, 8e-5, 700.0]])
    looks = iter([first, InputError("the gap has closed")])

    def grown(*_, **__):
        one = next(looks)
        if isinstance(one, InputError):
            raise one
        return one

    search = search_with(grown)
    held = attempt(["worn_bearing"], 1.0).hypotheses
    row = np.array([3e-4, 6e-5, 700.0])
    assert fit_everywhere(search, held, row, 0, attempt([], 100.0), anew=True) is first
    assert next(looks, None) is None


@pytest.mark.parametrize(
    ("shown", "fitted", "expected"),
    [(4e-4, 4.04e-4, None), (4e-4, 4.41e-4, 4.2e-4), (4.41e-4, 4e-4, 4.2e-4), (4e-4, 6e-4, 4e-4)],
)
def test_between_two_clearances_that_differ_a_little_lies_their_mean(shown, fitted, expected):
    assert between(shown, fitted) == (None if expected is None else pytest.approx(expected))
