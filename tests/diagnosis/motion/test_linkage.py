"""What an encoder and a position sensor say of one another, and which forces a measured turning needs."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.motion.balance import accelerations, suggest
from clearance.diagnosis.motion.linkage import Linkage, link, slider
from clearance.diagnosis.motion.model import Model, gather
from clearance.diagnosis.motion.prediction import Guess, predict
from clearance.diagnosis.motion.track import Track
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.mechanism.drive import DirectCurrentMotor, SpeedControl
from clearance.mechanism.slider_crank import Link, SliderCrank

# A slider that hangs beside a disk, on an offset guide, as teaching laboratories have it; x points down.
RIG = SliderCrank(
    crank=Link(0.5, 3e-3, 0.075, 0.0), rod=Link(0.02, 1e-4, 0.26), slider=Link(0.1, 1e-5, 0.01),
    guide_offset=-0.155,
)  # fmt: skip
CHANNELS = ("crank_angle", "crank_speed", "slider_position", "slider_velocity")


def recorded(machine, zero=0.0, instrument=None, speed=12.0, seed=1, seconds=6.0):
    """Samples at 50 Hz of a machine with ideal joints, with the noise of a cheap encoder."""
    blank = Track("rig", np.zeros((round(50.0 * seconds), 4)), CHANNELS, 50.0)
    values = predict(blank, [Guess(machine, instrument or Instrument(), 0.5, speed, 0.0)])[0]
    values[:, 0] += zero
    noise = np.array([2e-3, 0.1, 3e-4, 1e-2]) * np.random.default_rng(seed).normal(size=values.shape)
    return Track("rig", values + noise, CHANNELS, 50.0)


def terms_of(track, machine):
    effects = [effect.around(machine) for effect in load_effects("all")]
    return gather(effects, machine, "C", [track], [], 2.0)


def motor(**changes):
    return replace(RIG, drive=DirectCurrentMotor(0.3, 150.0), **changes)


def test_the_slider_stands_where_the_general_simulator_has_it():
    track = Track("", np.zeros((100, 2)), ("crank_angle", "slider_position"), 50.0)
    angle, position = predict(track, [Guess(motor(), Instrument(), 0.3, 9.0, 0.0)])[0].T
    assert slider(RIG, angle) == pytest.approx(position, abs=1e-6)


def test_nothing_is_said_where_nothing_is_wrong():
    track = recorded(motor())
    found = link([track], RIG, terms_of(track, RIG), "C")
    assert (found.terms, found.turned) == ((), ())
    assert found.zero("rig") == pytest.approx(0.0, abs=2e-3)


def test_without_angle_or_position_nothing_is_said():
    track = recorded(motor()).only("crank_angle")
    assert link([track], RIG, {}, "C") == Linkage()


def test_zero_offset_size_delay_and_a_guide_elsewhere_are_found_together():
    faults = Instrument()
    for name, value in (("gain", 1.03), ("delay", 4e-3), ("bias", -0.3)):
        faults = faults.changed(name, value, "slider_position")
    track = recorded(motor(guide_offset=-0.16), 2.5, faults)
    found = link([track], RIG, terms_of(track, RIG), "C")
    said = {}
    for term, values in zip(found.terms, found.values, strict=True):
        said |= term.values(values)
    assert set(said) == {"gain", "delay", "bias", "offset"}
    for name, truth, sure in (
        ("gain", 1.03, 5e-3), ("delay", 4e-3, 1e-3), ("bias", -0.3, 2e-3), ("offset", -0.16, 1e-3)
    ):  # fmt: skip
        assert said[name] == pytest.approx(truth, abs=sure), name
    assert found.zero("rig") == pytest.approx(2.5, abs=0.02)


@pytest.mark.parametrize("senses", [(-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
def test_channels_that_count_the_other_way_are_turned(senses):
    track = recorded(motor())
    signs = np.repeat(senses, 2)
    other = Track("rig", track.values * signs, CHANNELS, 50.0)
    found = link([other], RIG, terms_of(other, RIG), "C")
    assert found.turned == tuple(c for c, sign in zip(CHANNELS, signs, strict=True) if sign < 0.0)
    assert found.oriented(other).values == pytest.approx(track.values)


def test_laws_accelerate_the_crank_as_they_do_in_a_run():
    machine = motor(gravity=(9.81, 0.0))
    rate = 2000.0
    track = Track("", np.zeros((400, 2)), ("crank_angle", "crank_speed"), rate)
    angle, speed = predict(track, [Guess(machine, Instrument(), 0.3, 9.0, 0.0)])[0].T
    expected = np.gradient(speed, 1.0 / rate)[1:-1]
    assert accelerations(machine, angle, speed)[1:-1] == pytest.approx(expected, abs=1e-3 * np.ptp(expected))


def test_a_measured_turning_tells_gravity_friction_and_motor_together():
    (friction,) = load_effects("guide_friction")
    machine = friction.machine(motor(gravity=(9.81, 0.0)), "C", {"coulomb_force": 0.6})
    track = recorded(machine, seconds=8.0)
    nominal = replace(RIG, drive=SpeedControl(150.0))
    model = Model(nominal, "C", uncertain={"crank.inertia": (1e-4, 1e-1)})
    found = suggest(model, [track], [0.0], [2.0], [], terms_of(track, nominal).values(), print)
    said = {t.name: t.values(v) for t, v in zip(found.terms, found.values, strict=True)}
    assert set(said) == {"soft_drive", "gravity", "guide_friction"}
    assert said["gravity"]["gravity_x"] == pytest.approx(9.81, rel=0.1)
    assert said["soft_drive"]["stall_torque"] == pytest.approx(0.3, rel=0.2)
    assert np.exp(found.uncertain[0]) == pytest.approx(3e-3, rel=0.1)
