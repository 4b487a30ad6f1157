"""Speed and phase of a recording from its accelerations alone."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from clearance.diagnosis.kinematics.alignment import Cycle, align
from clearance.errors import InputError
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal
from clearance.simulation.trajectory import simulate_trajectory

CHAIN = MeasurementChain()
RANGE = (30.0, 160.0)
ROD = (Signal.ROD_B_TRANSVERSE, Signal.ROD_B_AXIAL, Signal.ROD_C_TRANSVERSE, Signal.ROD_C_AXIAL)
SETS = {
    "rod": ROD,
    "slider": (Signal.SLIDER_HORIZONTAL,),
    "rod and crank": (Signal.CRANK_B_TRANSVERSE, Signal.CRANK_B_AXIAL, *ROD),
}
SETTLED = 0.25  # s


@cache
def recorded(joint, clearance, rpm):
    """Noisy filtered signals, and the true mean speed and angle of the first sample."""
    loose = {"joint_b" if joint == "B" else "joint_c": Joint(clearance)}
    machine = SliderCrank(drive=SpeedControl(rpm, ramp=0.05), **loose)
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-5, 2), SETTLED + 0.31)
    first = round(SETTLED * CHAIN.base_rate)
    values = CHAIN.apply(run.signals[first - 1000 :])[100:3100]
    values += np.random.default_rng(0).normal(size=values.shape) * 0.01 * values.std(axis=0)
    angle = run.signals[first : first + 30000, Signal.CRANK_ANGLE]
    speed = np.polyfit(np.arange(30000) / CHAIN.base_rate, angle, 1)[0]
    return machine, values, speed, angle[0]


def turn(angle):
    """Angle in (-pi, pi]."""
    return float(np.angle(np.exp(1j * angle)))


@pytest.mark.parametrize("sensors", SETS)
@pytest.mark.parametrize(
    ("joint", "clearance", "rpm"),
    [("C", 3e-4, 700.0), ("C", 1e-3, 940.0), ("B", 5e-4, 560.0), ("B", 1e-4, 830.0)],
)
def test_speed_and_angle_are_found(joint, clearance, rpm, sensors):
    machine, values, speed, angle = recorded(joint, clearance, rpm)
    signals = SETS[sensors]
    found, start, explained = align(machine, values[:, list(signals)], signals, CHAIN.rate, RANGE)
    assert found == pytest.approx(speed, rel=5e-3)
    assert abs(turn(start - angle)) < 0.1
    assert 0.0 < explained < 1.0


def test_a_recording_shorter_than_a_turn_at_the_slowest_speed_is_aligned():
    """The harmonics of less than a turn, which cancel each other, must not score."""
    machine, values, speed, angle = recorded("C", 1e-4, 830.0)
    short = values[:1350, list(ROD)]  # 0.135 s: nearly two turns; one at 30 rad/s takes 0.21 s
    ringing = (
        0.1 * short.std(axis=0) * np.sin(2.0 * np.pi * 789.0 * np.arange(len(short)) / CHAIN.rate)[:, None]
    )
    found, start, _ = align(machine, short + ringing, ROD, CHAIN.rate, (15.7, 314.0))
    assert found == pytest.approx(speed, rel=1e-2)
    assert abs(turn(start - angle)) < 0.1


def test_the_clearance_of_the_machine_does_not_matter():
    machine, values, *_ = recorded("C", 3e-4, 700.0)
    other = replace(machine, joint_c=Joint(1e-3), drive=SpeedControl(300.0))
    first, second = (align(m, values[:, list(ROD)], ROD, CHAIN.rate, RANGE) for m in (machine, other))
    assert first == second


def test_a_frame_that_is_known_to_move_does_not_mislead():
    machine, values, speed, _ = recorded("C", 3e-4, 700.0)
    frame = FlexibleFrame()
    signals = (*ROD, Signal.CRANK_A_AXIAL, Signal.SLIDER_VERTICAL)
    shaken = values[:, list(signals)]
    shaken[:, -2:] = 0.2 * np.random.default_rng(3).normal(size=(len(shaken), 2))
    found, _, explained = align(replace(machine, frame=frame), shaken, signals, CHAIN.rate, RANGE)
    assert found == pytest.approx(speed, rel=5e-3)
    assert explained > 0.3


@pytest.mark.parametrize("zero", [0.0, 1.3])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_an_encoder_tells_the_speed_and_other_channels_whose_machine_it_is(zero, sense):
    machine, values, speed, angle = recorded("C", 3e-4, 700.0)
    signals = (*ROD, Signal.CRANK_ANGLE)
    values = values[:, list(signals)].copy()
    values[:, -1] = sense * (angle + zero + speed * np.arange(len(values)) / CHAIN.rate)
    if sense < 0.0:
        assert align(machine, values, signals, CHAIN.rate, RANGE)[0] == pytest.approx(-speed)
        return
    *told, explained = align(machine, values, signals, CHAIN.rate, RANGE)
    assert told == pytest.approx([speed, angle + zero])
    assert explained > 0.3
    stranger = values.copy()
    stranger[:, :-1] = values[:, :-1].std(axis=0) * np.random.default_rng(1).normal(size=(len(values), 4))
    assert align(machine, stranger, signals, CHAIN.rate, RANGE)[2] < 0.1


def test_an_encoder_is_believed():
    machine, values, speed, angle = recorded("C", 3e-4, 700.0)
    signals = (Signal.ROD_C_AXIAL, Signal.CRANK_ANGLE)
    values = values[:, list(signals)].copy()
    time = np.arange(len(values)) / CHAIN.rate
    values[:, 1] = angle + speed * time
    found, start, _ = align(machine, values, signals, CHAIN.rate, RANGE)
    assert found == pytest.approx(speed)
    assert abs(turn(start - angle)) < 1e-6


def test_noise_explains_nothing():
    values = np.random.default_rng(1).normal(size=(3000, 4))
    *_, explained = align(SliderCrank(), values, ROD, CHAIN.rate, RANGE)
    assert explained < 0.1


def test_channels_that_do_not_turn_with_the_crank_are_refused():
    values = np.random.default_rng(1).normal(size=(3000, 1))
    with pytest.raises(InputError, match="no channel turns with the crank"):
        align(SliderCrank(), values, (Signal.DRIVE_TORQUE,), CHAIN.rate, RANGE)


def test_a_cycle_is_that_of_ideal_kinematics():
    machine, speed = SliderCrank(joint_c=Joint(3e-4)), 70.0
    cycle = Cycle.of(machine, speed)
    angle = 2.0 * np.pi * np.arange(len(cycle.signals)) / len(cycle.signals)
    crank, rod = machine.crank.length, machine.rod.length
    position = crank * np.cos(angle) + np.sqrt(rod**2 - (crank * np.sin(angle)) ** 2)
    # linear interpolation between 720 places: (2 pi / 720)^2 / 8 of the curvature
    found = cycle.signals[:, Signal.SLIDER_POSITION]
    np.testing.assert_allclose(found, position, atol=1.5e-5 * crank)
    slope = np.fft.ifft(np.fft.fft(position) * 1j * np.fft.fftfreq(720, 1.0 / 720)).real
    bend = np.fft.ifft(-np.fft.fft(position) * np.fft.fftfreq(720, 1.0 / 720) ** 2).real
    # the drive is stiff, not ideal: its speed ripples by half a per cent
    velocity, acceleration = slope * speed, bend * speed**2
    np.testing.assert_allclose(
        cycle.signals[:, Signal.SLIDER_VELOCITY], velocity, atol=1e-2 * np.abs(velocity).max()
    )
    seen = cycle.signals[:, Signal.SLIDER_HORIZONTAL]
    np.testing.assert_allclose(seen, acceleration, atol=2e-2 * np.abs(acceleration).max())
    # with no friction on the guide, the force on the rod at C is minus what moves the slider
    np.testing.assert_allclose(cycle.force_c[:, 0], -machine.slider.mass * seen, atol=1e-6)
