"""What is expected of recordings that were held out."""

from copy import copy
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.judging import held_out as judging
from clearance.diagnosis.judging.held_out import _elsewhere, _passing, judge
from clearance.diagnosis.judging.mismatch import Innovations
from clearance.diagnosis.searching.explanation import Explanation
from clearance.errors import InputError
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.attempts import attempt


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"argument": "time", "spacing": 0.1}, True),
        ({"argument": "time", "period": 0.2}, False),  # goes on by its clock
        ({"argument": "slider_position", "spacing": 0.1}, False),
    ],
)
def test_only_a_force_over_one_recordings_time_says_nothing_of_another(table, expected):
    machine = SliderCrank(force=TabulatedForce(values=(1.0, 2.0, 3.0), **table))
    assert _passing(machine) == expected
    assert _elsewhere(machine) == (SliderCrank() if expected else machine)


def test_a_machine_without_a_table_is_looked_for_in_every_recording():
    assert not _passing(SliderCrank())


@pytest.mark.parametrize(
    ("nominal", "errors", "likelier", "withdrawn"),
    [
        (1.3, {"nominal": 0.7, "gravity": 1.0}, 0.0, True),  # made of chance
        (1.3, {"nominal": 1.2, "gravity": 1.0}, 0.0, False),
        (1.3, {"nominal": 1.01, "gravity": 1.0}, 0.0, False),
        (1.3, {"nominal": 1.0, "gravity": 1.0}, 0.0, True),  # held-out recordings show nothing of it
        (1.3, {"nominal": 1.0, "gravity": 1.0}, 500.0, False),  # but in impacts
        (1.3, {"nominal": 1.0004, "gravity": 1.0}, 500.0, False),
        (1.3, {"nominal": 1.0004, "gravity": 1.0}, -930.0, True),  # by a trifle, and impacts contradict it
        (1.3, {"nominal": 1.01, "gravity": 1.0}, -930.0, False),
        (1.03, {"nominal": 1.006, "gravity": 0.991}, 160.0, True),  # where nothing looks unusual
        (1.03, {"nominal": 1.006, "gravity": 0.991}, 494.0, False),
        (1.03, {"nominal": 1.006, "gravity": 0.991}, 0.0, False),  # on other stretches: not to be compared
        (1.3, {"nominal": 1.0, "gravity": 1.0}, 31.0, True),  # by chance: as on a machine that lacks nothing
        (50.0, {"nominal": 0.7, "gravity": 1.0}, 0.0, False),  # the nominal machine's path was lost
    ],
)
def test_what_the_nominal_machine_explains_as_well_on_held_out_recordings_is_withdrawn(
    monkeypatch, nominal, errors, likelier, withdrawn
):
    found, again, machine = attempt(["gravity"], 1.0), attempt(["gravity"], 1.01), attempt([], nominal)
    noise = np.random.default_rng(5).standard_normal((4000, 2))

    def innovations(one, joint, floor=None):
        flat = np.zeros(len(noise))
        return [Innovations(errors[one.label] * noise, flat, flat > 0, flat > 0, ("a", "b"), 1e4)]

    for one in (found, again, machine):
        one.fit.cost = 10_000.0
    machine.fit.cost += likelier
    monkeypatch.setattr(judging, "_held_out", lambda held_out, search, one, beside=None: one)
    monkeypatch.setattr(judging, "ask", lambda *_: None)
    monkeypatch.setattr(judging, "innovations", innovations)
    search = SimpleNamespace(report=lambda _: None, setting=SimpleNamespace(joint="C"), late=lambda: False)
    for one in (found, again, machine):
        for hypothesis in one.hypotheses:
            hypothesis.label = hypothesis.name
    judged = judge([], search, Explanation(machine, [found, again]))
    assert found.withdrawn == again.withdrawn == withdrawn  # what is not needed has no second try
    assert judged.after is (machine if withdrawn else found)
    assert judged.withdrawn == (["gravity"] if withdrawn else [])


@pytest.mark.parametrize(("left", "withdrawn"), [(1.0, False), (0.9, True)])
def test_what_held_out_recordings_do_not_show_stands_where_the_nominal_machine_fails(
    monkeypatch, left, withdrawn
):
    """A sensor that clips at the higher speed alone, of two recordings, says nothing at the lower one."""
    found, machine = attempt(["sensor_saturation"], 1.0, "instrument"), attempt([], 50.0)
    errors = {"sensor_saturation": 1.0, "nominal": left}
    noise = np.random.default_rng(5).standard_normal((4000, 2))

    def innovations(one, joint, floor=None):
        flat = np.zeros(len(noise))
        return [Innovations(errors[one.label] * noise, flat, flat > 0, flat > 0, ("a", "b"), 1e4)]

    there = {one.label: attempt([h.name for h in one.hypotheses], 1.0) for one in (found, machine)}
    found.hypotheses[0].label = found.label
    monkeypatch.setattr(judging, "_held_out", lambda held_out, search, one, beside=None: there[one.label])
    monkeypatch.setattr(judging, "ask", lambda *_: None)
    monkeypatch.setattr(judging, "innovations", innovations)
    search = SimpleNamespace(report=lambda _: None, setting=SimpleNamespace(joint="C"), late=lambda: False)
    judge([], search, Explanation(machine, [found]))
    assert found.withdrawn == withdrawn


@pytest.mark.parametrize(
    ("both", "shares", "expected"),
    [
        (0.99, (), ["gravity", "restitution"]),
        (1.0, (), ["gravity"]),
        (1.0, (0.6, 1.0), ["gravity", "restitution"]),  # the one was lost for a part
    ],
)
def test_a_second_effect_that_held_out_recordings_do_not_need_is_withdrawn(
    monkeypatch, both, shares, expected
):
    nominal, one = attempt([], 50.0), attempt(["gravity"], 1.04)
    pair, other = attempt(["gravity", "restitution"], 0.92), attempt(["gravity", "rod_inertia"], 0.93)
    pair.fit.cost = other.fit.cost = one.fit.cost
    one.shares = shares
    errors = {id(nominal): 9.0, id(one): 1.0, id(pair): both, id(other): both}
    for each in (nominal, one, pair, other):
        each.label = " + ".join(h.name for h in each.hypotheses) or "nominal"
        for hypothesis in each.hypotheses:
            hypothesis.label = hypothesis.name
    noise = np.random.default_rng(5).standard_normal((4000, 2))

    def innovations(one, joint, floor=None):
        flat = np.zeros(len(noise))
        return [Innovations(errors[id(one)] * noise, flat, flat > 0, flat > 0, ("a", "b"), 1e4)]

    monkeypatch.setattr(judging, "_held_out", lambda held_out, search, one, beside=None: one)
    monkeypatch.setattr(judging, "ask", lambda *_: None)
    monkeypatch.setattr(judging, "innovations", innovations)
    search = SimpleNamespace(report=lambda _: None, setting=SimpleNamespace(joint="C"), late=lambda: False)
    explanation = Explanation(nominal, [one, pair, other])
    judged = judge([], search, explanation)
    assert [h.name for h in judged.after.hypotheses] == expected
    assert explanation.best is judged.after
    assert other.withdrawn == (len(expected) == 1)
    assert judged.withdrawn == ([] if len(expected) == 2 else ["gravity + restitution"])


@pytest.mark.parametrize(
    ("late", "moved", "expected"),
    [
        (False, False, ["gravity", "restitution"]),
        (False, True, ["gravity", "restitution"]),
        (True, False, ["gravity"]),
    ],
)
def test_held_out_recordings_are_followed_once_a_fit_and_no_other_is_judged_when_time_is_over(
    monkeypatch, late, moved, expected
):
    nominal, one, other = attempt([], 1.3), attempt(["gravity"], 1.0), attempt(["restitution"], 1.01)
    for each in (nominal, one, other):
        each.fit.cost = 10_000.0
        each.label = " + ".join(h.name for h in each.hypotheses) or "nominal"
        for hypothesis in each.hypotheses:
            hypothesis.label = hypothesis.name
    followed = []

    def follow(held_out, search, one, beside=None):
        followed.append(one.label)
        return one

    def ask(*_):
        if moved:  # by the likelihood
            nominal.fit = copy(nominal.fit)

    flat = np.zeros(100)
    same = Innovations(np.ones((100, 2)), flat, flat > 0, flat > 0, ("a", "b"), 1e4)
    monkeypatch.setattr(judging, "_held_out", follow)
    monkeypatch.setattr(judging, "ask", ask)
    monkeypatch.setattr(judging, "innovations", lambda *_: [same])
    search = SimpleNamespace(report=lambda _: None, setting=SimpleNamespace(joint="C"), late=lambda: late)
    judged = judge([], search, Explanation(nominal, [one, other]))
    assert judged.after is nominal
    assert judged.withdrawn == expected
    again = ["nominal"] * 2 if moved else []  # beside the second, and once more at the end
    assert followed == ["gravity", "nominal", *expected[1:], *again]


def test_what_is_followed_by_a_clock_is_followed_again_by_another(monkeypatch):
    nominal, timed, plain = attempt([], 50.0), attempt(["free_form"], 1.0), attempt(["gravity"], 1.05)
    for each in (nominal, timed, plain):
        each.label = " + ".join(h.name for h in each.hypotheses) or "nominal"
        for hypothesis in each.hypotheses:
            hypothesis.label = hypothesis.name
    noise = np.random.default_rng(5).standard_normal((4000, 2))
    asked = []

    def followed(held_out, search, one, beside=None):
        asked.append((one.label, held_out[0].period))
        return one

    def innovations(one, joint, floor=None):
        flat = np.zeros(len(noise))
        return [
            Innovations(
                {"nominal": 0.9}.get(one.label, 1.0) * noise, flat, flat > 0, flat > 0, ("a", "b"), 1e4
            )
        ]

    def clocked(one, search, best):
        return SimpleNamespace(period=0.1 if best is timed else 0.0)

    nominal.fit.level = nominal.misfit
    monkeypatch.setattr(judging, "explained", lambda one: True)
    monkeypatch.setattr(judging, "_held_out", followed)
    monkeypatch.setattr(judging, "_clocked", clocked)
    monkeypatch.setattr(judging, "ask", lambda *_: None)
    monkeypatch.setattr(judging, "innovations", innovations)
    search = SimpleNamespace(report=lambda _: None, setting=SimpleNamespace(joint="C"), late=lambda: False)
    judge([SimpleNamespace(period=0.0)], search, Explanation(nominal, [timed, plain]))
    assert ("nominal", 0.1) in asked
    assert ("nominal", 0.0) in asked  # not what was followed by the first one's clock


@pytest.mark.parametrize(
    ("name", "patience", "expected"),
    [
        ("gravity", 40, "a onward b c"),
        ("guide_clearance", 40, "onward between a b c"),
        ("gravity", 0, "a"),
        ("guide_clearance", 0, "a"),
    ],
)
def test_ways_on_which_held_out_recordings_are_followed(monkeypatch, name, patience, expected):
    places = [lambda place=place: place for place in ("abc" if patience else "a")]
    monkeypatch.setattr(judging, "ways_to_follow", lambda *_: iter(places))
    monkeypatch.setattr(judging, "go_on", lambda *_: "onward")
    monkeypatch.setattr(judging, "_between_rails", lambda *_: "between")
    search, trace = SimpleNamespace(patient_until=np.inf), SimpleNamespace(speed=1.0)
    ways = judging._ways(search, attempt([name], 1.0), trace, None, patience)
    assert [way() for way in ways] == expected.split()


def test_the_speed_of_another_recording_is_sought_as_far_as_it_may_be():
    own, other = SimpleNamespace(name="1.csv"), SimpleNamespace(name="2.csv")
    search = SimpleNamespace(
        recordings=[own], alignments=[SimpleNamespace(speed=-70.0)], speed_range=(20.0, 300.0)
    )
    assert judging.speeds_of(own, search) == (35.0, 140.0)
    assert judging.speeds_of(other, search) == (20.0, 300.0)


def test_a_recording_that_was_held_out_and_shows_no_motion_is_named(monkeypatch):
    def lost(*_):
        raise np.linalg.LinAlgError("the linkage does not turn")

    force = TabulatedForce(body="frame", direction="x", argument="time", values=(1.0, -1.0), period=0.1)
    machine, fit = SimpleNamespace(force=force), SimpleNamespace(values=[None])
    timed = SimpleNamespace(model=SimpleNamespace(machine=lambda _: machine), fit=fit, followers=[])
    monkeypatch.setattr(judging, "aligned", lost)
    search = SimpleNamespace(recordings=[], speed_range=(50.0, 100.0))
    with pytest.raises(InputError, match=r"held_out: 3\.csv shows no motion"):
        judging._clocked(SimpleNamespace(name="3.csv"), search, timed)
