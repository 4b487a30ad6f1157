"""What an encoder and a position sensor say of one another, and which forces a measured turning needs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.motion.balance import accelerations, suggest
from clearance.diagnosis.motion.linkage import Linkage, link, slider
from clearance.diagnosis.motion.model import Model, gather
from clearance.diagnosis.motion.outcome import diagnose
from clearance.diagnosis.motion.prediction import Guess, predict
from clearance.diagnosis.motion.rest import angles, explained
from clearance.diagnosis.motion.search import Search
from clearance.diagnosis.motion.track import Track
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.errors import InputError
from clearance.mechanism.drive import DirectCurrentMotor, SpeedControl
from clearance.mechanism.slider_crank import Link, SliderCrank

# A slider that hangs beside a disk, on an offset guide, as teaching laboratories have it; x points down.
RIG = SliderCrank(
    crank=Link(0.5, 3e-3, 0.075, 0.0), rod=Link(0.02, 1e-4, 0.26), slider=Link(0.1, 1e-5, 0.01),
    guide_offset=-0.155,
)  # fmt: skip
CHANNELS = ("crank_angle", "crank_speed", "slider_position", "slider_velocity")


def recorded(machine, zero=0.0, instrument=None, speed=12.0, seed=1, seconds=6.0, noise=1.0):
    """Samples at 50 Hz of a machine with ideal joints, with the noise of a cheap encoder."""
    blank = Track("rig", np.zeros((round(50.0 * seconds), 4)), CHANNELS, 50.0)
    values = predict(blank, [Guess(machine, instrument or Instrument(), 0.5, speed, 0.0)])[0]
    values[:, 0] += zero
    noise = noise * np.array([2e-3, 0.1, 3e-4, 1e-2]) * np.random.default_rng(seed).normal(size=values.shape)
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


def test_without_noise_nothing_is_surer_than_a_number_can_be():
    faults = Instrument().changed("bias", -0.3, "slider_position")
    track = recorded(motor(), 0.0, faults, noise=0.0)
    found = link([track], RIG, terms_of(track, RIG), "C")
    assert [term.label for term in found.terms] == ["sensor_bias(slider_position)"]
    assert found.deviation >= 1e-4
    (unknown,) = found.terms[0].unknowns
    assert unknown.prior[1] >= unknown.step


def test_of_many_recordings_in_stretches_none_is_left_out():
    short = recorded(motor(), seconds=1.2)
    tracks = [recorded(motor(), seconds=60.0), *(replace(short, name=name) for name in "abc")]
    search = Search(tracks, RIG, "C", {}, {}, Linkage(), (1.0, 300.0), 1.0, 1, print)
    search.turns = 1.25
    names = [stretch.name for stretch in search.cut(tracks)]
    assert set(names) == {"rig", "a", "b", "c"}
    assert len(names) <= 52


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


@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_a_torque_drives_whichever_way_the_crank_counts(sense):
    """Recorded with the sense of the crank or with its own, it ends in that of the model."""
    track = recorded(motor())
    torque = 0.3 + np.random.default_rng(0).normal(size=(len(track.values), 1))
    values = np.hstack([track.values, torque])
    other = Track("rig", values * [-1.0, -1.0, 1.0, 1.0, sense], (*CHANNELS, "drive_torque"), 50.0)
    found = link([other], RIG, terms_of(other, RIG), "C")
    assert ("drive_torque" in found.turned) == (sense < 0.0)
    assert found.oriented(other).values == pytest.approx(values)


def test_a_motor_turns_either_way_alike():
    track = Track("", np.zeros((100, 2)), ("crank_angle", "crank_speed"), 50.0)
    level = replace(RIG, guide_offset=0.0)
    found = []
    for sense in (1.0, -1.0):
        machine = replace(level, drive=DirectCurrentMotor(0.3, sense * 150.0))
        found.append(predict(track, [Guess(machine, Instrument(), sense * 0.3, sense * 9.0, 0.0)]))
    there, back = found
    assert np.isfinite(there).all()
    assert back == pytest.approx(-there, abs=1e-9)


def test_laws_accelerate_the_crank_as_they_do_in_a_run():
    machine = motor(gravity=(9.81, 0.0))
    rate = 2000.0
    track = Track("", np.zeros((400, 2)), ("crank_angle", "crank_speed"), rate)
    angle, speed = predict(track, [Guess(machine, Instrument(), 0.3, 9.0, 0.0)])[0].T
    expected = np.gradient(speed, 1.0 / rate)[1:-1]
    assert accelerations(machine, angle, speed)[1:-1] == pytest.approx(expected, abs=1e-3 * np.ptp(expected))


def test_a_drive_that_is_stiffer_than_any_is_not_run_and_leaves_its_neighbour_alone():
    track = Track("", np.zeros((50, 1)), ("crank_angle",), 50.0)
    stiff = replace(RIG, drive=DirectCurrentMotor(1e5, 150.0))
    guesses = [Guess(machine, Instrument(), 0.3, 9.0, 0.0) for machine in (motor(), stiff)]
    alone, beside = predict(track, guesses[:1])[0], predict(track, guesses)
    assert beside[0] == pytest.approx(alone, abs=1e-9)
    assert np.isnan(beside[1]).all()
    assert np.isnan(predict(track, guesses[1:])).all()


def test_a_recording_in_stretches_is_the_same_recording():
    track = recorded(motor())
    parts = track.cut(70)
    assert [len(part.values) for part in parts] == [75] * 4
    assert np.concatenate([part.values for part in parts]) == pytest.approx(track.values)


def test_what_comes_back_with_the_angle_is_seen_over_many_short_stretches():
    generator = np.random.default_rng(2)
    tracks = [replace(one, values=0.0 * one.values) for one in recorded(motor(), seconds=12.0).cut(25)]
    model = Model(motor(), "C")
    own = np.array([[0.5 + 4.0 * r, 12.0, 0.0, 150.0, 0.0] for r in range(len(tracks))])
    turned = angles(SimpleNamespace(model=model, shared=np.zeros(0), own=own), tracks)
    for wave, seen in ((0.0, False), (1.0, True)):
        rests = [
            generator.normal(size=(len(angle), 4)) + wave * np.cos(3.0 * angle)[:, None] for angle in turned
        ]
        found = explained(SimpleNamespace(model=model, shared=np.zeros(0), own=own, residuals=rests), tracks)
        assert found.noise == pytest.approx(np.ones(4), rel=0.15)
        assert found.structured.all() == seen
        assert found.structured.any() == seen


def test_a_measured_turning_of_less_than_a_few_means_says_nothing():
    track = recorded(motor(), seconds=1.2)
    nominal = replace(RIG, drive=SpeedControl(150.0))
    terms = list(terms_of(track, nominal).values())
    for turns in (0.2, 0.8):
        assert suggest(Model(nominal, "C"), [track], [0.0], [turns], [], terms, print) == []


def test_bounds_of_a_dimension_count_from_the_machines_own():
    (offset,) = load_effects("slider_offset")
    (own,) = offset.around(RIG).free
    assert own.bounds == pytest.approx((-0.205, -0.105))
    assert own.start == pytest.approx(-0.154)
    assert offset.around(SliderCrank()).free[0].bounds == offset.free[0].bounds


@pytest.mark.slow
def test_a_rig_of_which_hardly_anything_is_known_is_explained():
    """Motor, gravity, friction, a guide elsewhere, an encoder off zero, a sensor late and upside down."""
    (friction,) = load_effects("guide_friction")
    machine = friction.machine(motor(gravity=(9.81, 0.0), guide_offset=-0.158), "C", {"coulomb_force": 0.4})
    faults = Instrument().changed("bias", -0.3, "slider_position").changed("delay", 4e-3, "slider_position")
    tracks = []
    for name, rpm, speed in (("slow", 90.0, 6.0), ("fast", 220.0, 18.0)):
        moved = replace(machine, drive=DirectCurrentMotor(0.3, rpm))
        track = recorded(moved, 2.0, faults, speed, seconds=6.0)
        tracks.append(replace(track, name=name, values=track.values * [1.0, 1.0, -1.0, -1.0]))
    nominal = replace(RIG, drive=SpeedControl(150.0))
    fitted = [track.part(0, 200) for track in tracks]
    held_out = [track.part(200, 300) for track in tracks]
    found = diagnose(
        fitted, held_out, Setting(nominal, "C"), [e.around(nominal) for e in load_effects("all")],
        {"crank.inertia": (1e-4, 1e-1)}, False, (2.0, 300.0), 240.0, 1, 5, print,
    ).diagnosis  # fmt: skip
    assert found["verdict"] == "mixed"
    named = {effect["name"]: effect["parameters"] for effect in found["effects"]}
    assert {"soft_drive", "gravity", "guide_friction", "slider_offset", "sensor_bias"} <= set(named)
    gravity, offset = named["gravity"]["gravity_x"], named["slider_offset"]["offset"]
    assert gravity["value"] == pytest.approx(9.81, rel=0.05)
    assert offset["value"] == pytest.approx(-0.158, abs=5e-4)
    held = found["fit"]["held_out"]
    assert held["after"] < 1.2 < 10.0 < held["before"]
    assert any("slider_position: -1.0" in line for line in found["warnings"])


def test_a_measured_turning_tells_gravity_friction_and_motor_together():
    (friction,) = load_effects("guide_friction")
    machine = friction.machine(motor(gravity=(9.81, 0.0)), "C", {"coulomb_force": 0.6})
    track = recorded(machine, seconds=8.0)
    nominal = replace(RIG, drive=SpeedControl(150.0))
    model = Model(nominal, "C", uncertain={"crank.inertia": (1e-4, 1e-1)})
    first, *_ = suggest(model, [track], [0.0], [2.0], [], terms_of(track, nominal).values(), print)
    said = {t.name: t.values(v) for t, v in zip(first.terms, first.values, strict=True)}
    assert set(said) == {"soft_drive", "gravity", "guide_friction"}
    assert said["gravity"]["gravity_x"] == pytest.approx(9.81, rel=0.1)
    assert said["soft_drive"]["stall_torque"] == pytest.approx(0.3, rel=0.2)
    assert np.exp(first.uncertain[0]) == pytest.approx(3e-3, rel=0.1)


def test_a_nominal_drive_that_is_too_stiff_to_be_run_is_refused_with_its_key():
    track = recorded(motor(), seconds=3.0)
    nominal = replace(RIG, drive=SpeedControl(150.0, proportional=2000.0))
    with pytest.raises(
        InputError, match=r"proportional=2000.*drive\.proportional.*drive=direct_current_motor"
    ):
        diagnose(
            [track.part(0, 100)], [track.part(100, 150)], Setting(nominal, "C"), [], {}, False,
            (2.0, 300.0), 60.0, 1, 5, print,
        )  # fmt: skip
