"""Claims of a corrected machine and curves of a free-form force, beside the truth."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.trial.claim import left_over, likeness
from clearance.trial.simulate import simulate
from tests.trial.test_score import FRICTION, friction, scored
from tests.trial.tool import verdict


@pytest.fixture(scope="module")
def secrets():
    return simulate(FRICTION).secrets


def test_a_force_over_time_is_compared_by_the_clock_of_each_recording():
    begun = np.concatenate([0.8 + 1e-3 * np.arange(200), 0.85 + 1e-3 * np.arange(200)])
    clock = np.repeat([0.0, 0.013], 200)
    curve = {"time": begun, "force": np.sin(2.0 * np.pi * (begun + clock) / 0.05)}
    knots = 0.05 * np.arange(24) / 24
    said = {"argument": "time", "period": 0.05, "clocks": [0.0, 0.013],
            "table": [[t, np.sin(2.0 * np.pi * t / 0.05)] for t in knots]}  # fmt: skip
    correlation, error = likeness(curve, said)
    assert correlation > 0.99
    assert error < 0.1
    assert likeness(curve, {**said, "clocks": [0.0, 0.038]})[0] < 0.5


def test_what_is_constant_in_a_torque_is_the_drives():
    angle = np.linspace(0.0, 40.0, 4000)
    pulses = np.exp(8.0 * (np.cos(angle) - 1.0))
    knots = 2.0 * np.pi * np.arange(48) / 48
    table = np.exp(8.0 * (np.cos(knots) - 1.0))
    said = {"argument": "crank_angle", "table": np.stack([knots, table - table.mean()], 1).tolist()}
    correlation, error = likeness({"crank_angle": angle, "force": pulses}, {**said, "direction": "torque"})
    assert correlation > 0.99
    assert error < 0.1
    assert likeness({"crank_angle": angle, "force": pulses}, {**said, "direction": "x"})[1] > 0.4


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [
        ("rust", "depth", 1.0),  # no effect of the plant
        ("guide_friction", "depth", 1.0),  # no parameter of it
        ("contact_stiffness", "stiffness_scale", 1e308),  # flies apart
        ("slider_offset", "offset", 0.2),  # the rod does not reach the guide
        ("rod_flexibility", "frequency", 1e200),  # its square is beyond all numbers
    ],
)
def test_a_machine_that_cannot_be_is_no_claim_that_is_borne_out(secrets, name, parameter, value):
    effect = {"name": name, "kind": "physics", "parameters": {parameter: {"value": value}}}
    assert left_over(FRICTION, secrets, verdict("physics", [effect])) is None


def test_an_error_of_the_scorer_is_not_taken_for_a_wrong_claim(secrets):
    """What the scorer cannot read is no machine that cannot run."""
    for key in ("spread", "scenes"):
        damaged = {name: value for name, value in secrets.items() if name != key}
        with pytest.raises(KeyError):
            left_over(FRICTION, damaged, verdict("physics", [friction()]))
    fewer = {**secrets, "responses": [[[0.0] * 10] * 50]}  # than there are scenes
    with pytest.raises(ValueError, match="longer"):
        left_over(FRICTION, fewer, verdict("physics", [friction()]))


def test_a_claim_is_checked_where_nobody_has_looked(secrets):
    """The right machine leaves nothing; wrong numbers, or a wrong clearance, do, whatever is claimed."""
    right = scored(FRICTION, verdict("physics", [friction()]), secrets)
    assert right["left_over"] < 1e-3
    for said in (
        verdict("physics", [friction(8.0)]),
        verdict("none"),
        verdict("physics", [friction()], clearance=3.3e-4),
    ):
        assert scored(FRICTION, said, secrets)["left_over"] > 1.0
    assert scored(FRICTION, verdict("physics", [friction()], clearance=3.0003e-4), secrets)["left_over"] < 1.0


@pytest.mark.parametrize(("stall", "no_load"), [(50.0, 1.01), (20.0, 1.03), (6.0, 1.08)])
def test_a_motor_is_known_by_its_stall_torque(stall, no_load):
    """The speed at which it runs free is each recording's own, and no verdict repeats it."""
    motor = replace(FRICTION, effects={"soft_drive": {"stall_torque": stall, "no_load_ratio": no_load}})
    known = simulate(motor).secrets

    def said(value):
        effect = {"name": "soft_drive", "kind": "physics", "parameters": {"stall_torque": {"value": value}}}
        return verdict("physics", [effect])

    assert left_over(motor, known, said(stall)) < 1e-3
    assert left_over(motor, known, said(1.5 * stall)) > 1e-2
