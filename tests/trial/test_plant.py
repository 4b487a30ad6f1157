"""The plant against closed forms and against the engine: same physics, no common code."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import clearance.trial.plant as package
from clearance.mechanism.bearing import Worn
from clearance.mechanism.contact import Flores, HuntCrossley, LankaraniNikravesh
from clearance.mechanism.drive import DirectCurrentMotor, SpeedControl, TorqueRipple
from clearance.mechanism.film import SqueezeFilm
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.friction import Coulomb
from clearance.mechanism.guide import LooseGuide, StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.link import FlexibleRod
from clearance.mechanism.load import ConstantProcess, LinearSpring
from clearance.mechanism.slider_crank import Link, SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS, OTHER_CHANNELS
from clearance.recording.files import read
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import STATES, State
from clearance.simulation.trajectory import simulate_trajectory
from clearance.trial.plant import CHANNELS, ExtraForce, Fault, Plant, write_parquet
from clearance.trial.plant.kernels import COORDINATES, Q
from tests.simulation.scipy_model import ideal_kinematics

C = 1e-4
SPEED = 700.0
ANGLE = 0.5
DURATION = 0.012
DRIVE = SpeedControl(SPEED, ramp=0.0)
NAMES = {
    State.CRANK_ANGLE: Q.CRANK, State.ROD_X: Q.ROD_X, State.ROD_Y: Q.ROD_Y, State.ROD_ANGLE: Q.ROD,
    State.SLIDER_X: Q.SLIDER_X, State.SLIDER_Y: Q.SLIDER_Y,
}  # fmt: skip


def machine(joint, laws=None, **changes):
    """The engine's machine with clearance in a joint and laws in it."""
    loose = Joint(C, **(laws or {}))
    places = {"joint_b": Joint(), "joint_c": Joint(), "drive": DRIVE}
    if joint in ("B", "both"):
        places["joint_b"] = loose
    if joint in ("C", "both"):
        places["joint_c"] = loose
    return SliderCrank(**{**places, **changes})


def engine_signals(engine, plant, step):
    """The engine's signals at 100 kHz from the plant's own start."""
    start, state = plant.start(ANGLE, SPEED), np.zeros(STATES)
    for ours, theirs in NAMES.items():
        state[ours], state[COORDINATES - 2 + ours] = start[theirs], start[COORDINATES + theirs]
    scheme = Integrator("runge_kutta_4", step)
    return simulate_trajectory(engine, scheme, DURATION, round(1e-5 / step), state).signals


def plant_of(joint, effects=None, **changes):
    settings = {"clearance": C, "speed_rpm": SPEED, "ramp": 0.0, "step": 5e-7, **changes}
    return Plant(joint=joint, effects=effects or {}, **settings)


def signals_of(plant):
    return plant.run(DURATION, ANGLE, SPEED).signals


def distance(one, other):
    """Of the ten accelerations, root mean square [m/s²]."""
    return np.sqrt(np.mean((one[:, :10] - other[:, :10]) ** 2))


def test_without_clearance_it_is_the_closed_form():
    for offset in (0.0, 0.01):
        plant = plant_of("none", {"slider_offset": {"offset": offset}})
        signals = signals_of(plant)
        exact = ideal_kinematics(signals[:, 10], signals[:, 11], signals[:, 2] / 0.05, offset=offset)
        np.testing.assert_allclose(signals[:, :10], exact["channels"], atol=1e-7)
        np.testing.assert_allclose(signals[:, 13], exact["slider_position"], atol=1e-12)
        np.testing.assert_allclose(signals[:, 14], exact["slider_velocity"], atol=1e-10)


@pytest.mark.parametrize("joint", ["none", "B", "C", "both"])
def test_the_nominal_plant_is_the_engine_at_a_fine_step(joint):
    """From rest, as closely as the plant's own step allows, which goes across touches."""
    plant = Plant(joint=joint, clearance=C, speed_rpm=SPEED, ramp=0.1, step=5e-7)
    own = plant.run(0.03).signals
    scale = own[:, :10].std(axis=0).max()
    engine = machine(joint, drive=SpeedControl(SPEED, ramp=0.1))
    errors = []
    for step in (5e-6, 1e-6):
        run = simulate_trajectory(engine, Integrator("runge_kutta_4", step), 0.03, round(1e-5 / step))
        errors.append(distance(own, run.signals) / scale)
    np.testing.assert_allclose(run.signals[:, 10], own[:, 10], atol=1e-6)
    if joint == "none":
        assert errors[1] < 1e-10
    else:
        assert errors[1] < (6e-3 if joint == "both" else 5e-4)
        assert errors[1] < 0.1 * errors[0]


EFFECTS = {
    "joint_friction": ({"friction_coefficient": 0.1}, {"friction": Coulomb(0.1)}, {}),
    "joint_lubrication": ({"damping": 10.0}, {"film": SqueezeFilm(10.0)}, {}),
    "worn_bearing": ({"amplitude": 3e-5, "order": 3, "phase": 0.7}, {"bearing": Worn(3e-5, 3, 0.7)}, {}),
    "restitution": ({"restitution": 0.6}, {"contact": LankaraniNikravesh(0.6)}, {}),
    "restitution (Hunt-Crossley)": (
        {"restitution": 0.7, "law": "hunt_crossley"}, {"contact": HuntCrossley(0.7)}, {}),
    "restitution (Flores)": ({"restitution": 0.7, "law": "flores"}, {"contact": Flores(0.7)}, {}),
    "contact_stiffness": ({"scale": 0.3}, {"contact": LankaraniNikravesh(stiffness_scale=0.3)}, {}),
    "guide_friction": (
        # as fast as the slider here, so that it shows
        {"coulomb_force": 5.0, "viscous_damping": 3.0, "stribeck_force": 8.0, "stribeck_velocity": 3.0},
        {}, {"guide_friction": StribeckGuide(5.0, 3.0, 8.0, 3.0)}),
    "guide_friction (reaction)": (
        {"friction_coefficient": 0.2}, {}, {"guide_friction": StribeckGuide(friction_coefficient=0.2)}),
    "guide_clearance": (
        {"gap": 1e-5, "damping": 80.0}, {}, {"guide": LooseGuide(1e-5, damping=80.0)}),
    "slider_offset": ({"offset": 0.005}, {}, {"guide_offset": 0.005}),
    "rod_inertia": (
        {"mass_ratio": 1.2, "inertia_ratio": 1.1, "com_shift": 0.006},
        {}, {"rod": Link(0.21 * 1.2, 2.5e-4 * 1.1, 0.12, 0.55)}),
    "rod_flexibility": (
        {"frequency": 600.0, "damping_ratio": 0.02, "second_order": 0.0},
        {}, {"link": FlexibleRod(600.0, 0.02)}),
    "torque_ripple": (
        {"amplitude": 0.2, "order": 5, "phase": 0.3}, {}, {"ripple": TorqueRipple(0.2, 5.0, 0.3)}),
    "soft_drive": (
        {"proportional": 1.0, "integral": 30.0},
        {}, {"drive": replace(DRIVE, proportional=1.0, integral=30.0)}),
    "soft_drive (motor)": (
        {"stall_torque": 2.0, "no_load_rpm": 720.0}, {}, {"drive": DirectCurrentMotor(2.0, 720.0)}),
    "slider_spring": (
        {"stiffness": 800.0, "free_position": 0.12}, {}, {"spring": LinearSpring(800.0, 0.12)}),
    "process_load": (
        {"force": 30.0, "start": 0.14, "end": 0.155}, {}, {"process": ConstantProcess(30.0, 0.14, 0.155)}),
    "gravity": ({"gravity_x": 1.5, "gravity_y": -9.81}, {}, {"gravity": (1.5, -9.81)}),
    "flexible_base": (
        {"frequency": 80.0, "damping_ratio": 0.05, "mass": 10.0},
        {}, {"frame": FlexibleFrame(80.0, 0.05, 10.0)}),
}  # fmt: skip
CASES = [(name, "C") for name in EFFECTS]
CASES += [(name, "B") for name in ("joint_friction", "joint_lubrication", "worn_bearing", "rod_inertia")]
CASES += [(name, "B") for name in ("guide_friction (reaction)", "rod_flexibility", "flexible_base")]
CASES += [(name, "none") for name in ("guide_friction (reaction)", "rod_flexibility", "flexible_base")]


@pytest.fixture(scope="module")
def nominal():
    return {joint: signals_of(plant_of(joint)) for joint in ("none", "B", "C")}


@pytest.mark.parametrize(("name", "joint"), CASES)
def test_each_effect_is_the_engines_law(name, joint, nominal):
    values, laws, changes = EFFECTS[name]
    plant = plant_of(joint, {name.split(" ")[0]: values})
    own = signals_of(plant)
    other = engine_signals(machine(joint, laws, **changes), plant, 1e-7)
    change, error = distance(own, nominal[joint]), distance(own, other)
    # what is left is the engine's approach speed, first order in its step (seen: 1e-3 to 1e-2, none: 1e-4)
    assert error < (1e-3 if joint == "none" else 2e-2) * change
    if joint != "none" and error > 2e-3 * change:
        finer = engine_signals(machine(joint, laws, **changes), plant, 1e-8)
        assert distance(own, finer) < 2e-3 * change


def test_the_second_clearance_is_in_the_other_joint():
    plant = plant_of("C", {"second_clearance": {"clearance": 2e-4}})
    assert plant.clearances() == (2e-4, C)
    assert plant_of("B", {"second_clearance": {"clearance": 2e-4}}).clearances() == (C, 2e-4)
    own, nominal = signals_of(plant), signals_of(plant_of("C"))
    other = engine_signals(machine("C", joint_b=Joint(2e-4)), plant, 2.5e-8)
    assert distance(own, other) < 2e-2 * distance(own, nominal)


def test_the_step_is_fine_enough():
    coarse, fine = signals_of(plant_of("C", step=1e-6)), signals_of(plant_of("C", step=1e-7))
    assert distance(coarse, fine) < 1e-3 * fine[:, :10].std(axis=0).max()


FORCES = [
    ("slider_x", "slider_position", "cubic_spring", 10.0, 0.12, 0.05),
    ("slider_x", "slider_velocity", "quadratic_drag", 10.0, 0.0, 3.0),
    ("slider_x", "time", "square_wave", 10.0, 0.0, 0.01),
    ("slider_x", "slider_position", "bump", 10.0, 0.15, 0.005),
    ("rod_moment", "rod_angle", "dead_band_spring", 0.5, 0.0, 0.1),
    ("crank_torque", "crank_angle", "random_periodic", 0.5, 0.0, 2 * np.pi),
    ("slider_x", "slider_velocity", "one_sided_quadratic", 10.0, -3.0, 3.0),
    ("slider_x", "slider_position", "exponential_wall", 10.0, 0.16, 0.005),
    ("crank_torque", "crank_angle", "pulse_train", 0.5, 0.0, np.pi),
]


SHAPES = {
    "cubic_spring": lambda u: -(u**3),
    "quadratic_drag": lambda u: -np.sign(u) * u**2,
    "square_wave": lambda u: np.tanh(20.0 * np.sin(2.0 * np.pi * u + 0.4)),
    "bump": lambda u: np.exp(-(u**2) / 2.0),
    "dead_band_spring": lambda u: -np.sign(u) * np.maximum(np.abs(u) - 1.0, 0.0),
    "one_sided_quadratic": lambda u: -(np.maximum(u, 0.0) ** 2),
    "exponential_wall": lambda u: -np.exp(u),
    "pulse_train": lambda u: np.exp(8.0 * (np.cos(2.0 * np.pi * u + 0.4) - 1.0)),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_an_extra_force_has_the_shape_that_is_written(kind):
    u = np.linspace(-3.0, 3.0, 601)
    extra = ExtraForce(
        target="slider_x", argument="time", kind=kind, size=7.0, centre=0.2, width=0.05, phase=0.4
    )
    np.testing.assert_allclose(extra.value(0.2 + 0.05 * u), 7.0 * SHAPES[kind](u), rtol=1e-9, atol=1e-9)


def test_a_random_force_repeats_with_six_harmonics_that_fall():
    turn = np.arange(720) / 720
    sizes = []
    for seed in range(200):
        extra = ExtraForce(
            target="slider_x", argument="time", kind="random_periodic", size=3.0, width=0.2, seed=seed
        )
        value = extra.value(0.2 * turn)
        np.testing.assert_allclose(extra.value(0.2 * (turn + 5.0)), value, atol=1e-9)
        assert np.abs(value).max() == pytest.approx(3.0, rel=1e-3)
        spectrum = np.abs(np.fft.rfft(value)) / len(turn)
        assert spectrum[[0, *range(7, 360)]].max() < 1e-9
        sizes.append(spectrum[1:7] / np.linalg.norm(spectrum[1:7]))
    share = np.sqrt(np.mean(np.square(sizes), axis=0))
    assert share[1:] / share[0] == pytest.approx(1.0 / np.arange(2, 7), rel=0.3)


@pytest.mark.parametrize("force", FORCES, ids=lambda force: f"{force[2]} on {force[0]}")
def test_an_extra_force_does_the_work_it_should(force):
    """Without drive, the ideal mechanism's energy changes by the extra force's work alone."""
    target, argument, kind, size, centre, width = force
    extra = ExtraForce(
        target=target, argument=argument, kind=kind, size=size, centre=centre, width=width, seed=3
    )
    plant = Plant(joint="none", speed_rpm=SPEED, extra=extra, kp=0.0, ki=0.0)
    run = plant.run(0.03, ANGLE, SPEED, truth=True)
    y = run.signals
    exact = ideal_kinematics(y[:, 10], y[:, 11], 0.0)
    theta, omega, phi, spin = y[:, 10], y[:, 11], exact["rod_angle"], exact["rod_speed"]
    rod_vx = -0.05 * np.sin(theta) * omega - 0.06 * np.sin(phi) * spin
    rod_vy = 0.05 * np.cos(theta) * omega + 0.06 * np.cos(phi) * spin
    crank = 1e-5 + 0.3 * 0.025**2
    energy = 0.5 * crank * omega**2 + 0.5 * 2.5e-4 * spin**2 + 0.07 * y[:, 14] ** 2
    energy += 0.105 * (rod_vx**2 + rod_vy**2)
    velocities = {"slider_x": y[:, 14], "rod_moment": spin, "crank_torque": omega}
    arguments = {
        "slider_position": y[:, 13], "slider_velocity": y[:, 14], "crank_angle": theta, "rod_angle": phi,
        "time": np.arange(len(y)) * 1e-5,
    }  # fmt: skip
    truth = run.true("EXTRA")
    np.testing.assert_allclose(extra.value(arguments[argument]), truth, rtol=1e-6, atol=1e-9)
    power = truth * velocities[target]
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * 1e-5)])
    assert np.ptp(work) > 1e-4
    np.testing.assert_allclose(energy - energy[0], work, atol=1e-4 * np.ptp(work) + 1e-9)


def test_a_force_on_the_frame_moves_the_frame():
    extra = ExtraForce(target="frame_x", argument="time", kind="bump", size=50.0)
    with pytest.raises(ValueError, match="flexible_base"):
        Plant(extra=extra)
    base = {"flexible_base": {"frequency": 20.0, "damping_ratio": 0.0, "mass": 20.0}}
    rest = {"joint": "none", "speed_rpm": 0.0, "kp": 0.0, "ki": 0.0}
    first = Plant(effects=base, extra=extra, **rest).run(1e-4).signals[0]
    assert first[1] == pytest.approx(50.0 / (20.0 + 0.3 + 0.21 + 0.14))


@pytest.fixture(scope="module")
def run():
    return Plant(joint="B", speed_rpm=SPEED, ramp=0.0, clearance=C).run(0.2, ANGLE, SPEED).signals


def record(**changes):
    settings = {"record_start": 0.05, "noise": 0.0, "start_angle": ANGLE, "start_speed_rpm": SPEED}
    plant = Plant(joint="B", speed_rpm=SPEED, ramp=0.0, clearance=C)
    return plant.recording(0.1, **{**settings, **changes})


def test_the_chain_is_the_one_of_the_project(run):
    assert (*ACCELERATIONS, *OTHER_CHANNELS) == CHANNELS
    table = record(encoder_counts=None)
    expected = MeasurementChain().apply(run)[500:1500]
    assert list(table) == ["time", *CHANNELS]
    np.testing.assert_allclose(table["time"], np.arange(1000) / 1e4)
    for index, name in enumerate(CHANNELS):
        if name != "crank_angle":
            # the filter's tails: 10 ms from the ends of the simulation
            spread = max(np.std(expected[:, index]), 1.0)
            np.testing.assert_allclose(table[name], expected[:, index], atol=2e-4 * spread)
    exact = run[5000:15000:10, 10]
    np.testing.assert_allclose(table["crank_angle"], exact - 2 * np.pi * np.floor(exact[0] / (2 * np.pi)))


def test_noise_and_encoder():
    clean, noisy = record(), record(noise=0.05, seed=4)
    for name in ("rod_c_axial", "slider_horizontal", "drive_torque"):
        level = np.std(noisy[name] - clean[name]) / np.std(clean[name])
        assert level == pytest.approx(0.05, rel=0.1)
    quietest = min(np.std(clean[name]) for name in ACCELERATIONS if np.std(clean[name]) > 1e-6)
    assert np.std(noisy["slider_vertical"]) == pytest.approx(0.01 * quietest, rel=0.1)
    counts = noisy["crank_angle"] * 4096 / (2 * np.pi)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    alone = record(noise=0.05, seed=4, channels=["rod_c_axial"])
    np.testing.assert_array_equal(alone["rod_c_axial"], noisy["rod_c_axial"])


def test_faults_of_the_instruments():
    clean, name = record(), "rod_c_axial"

    def faulty(kind, channel=name, **numbers):
        return record(faults=[Fault(kind=kind, channel=channel, **numbers)])[channel]

    np.testing.assert_allclose(faulty("sensor_gain", gain=1.1), 1.1 * clean[name])
    np.testing.assert_allclose(faulty("sensor_bias", bias=-3.0), clean[name] - 3.0)
    np.testing.assert_allclose(faulty("sensor_saturation", limit=90.0), np.clip(clean[name], -90.0, 90.0))
    axial = np.cos(0.1) * clean[name] + np.sin(0.1) * clean["rod_c_transverse"]
    np.testing.assert_allclose(faulty("sensor_misalignment", angle=0.1), axial)
    transverse = np.cos(0.1) * clean["rod_c_transverse"] - np.sin(0.1) * clean[name]
    np.testing.assert_allclose(
        faulty("sensor_misalignment", "rod_c_transverse", angle=0.1), transverse, atol=1e-9
    )
    np.testing.assert_allclose(faulty("sensor_delay", delay=3e-4)[3:], clean[name][:-3])
    # a turned sensor is as late in what it feels of the other axis, whatever that one's sensor does
    both = [
        Fault(kind="sensor_misalignment", channel=name, angle=0.1),
        Fault(kind="sensor_delay", channel=name, delay=3e-4),
    ]
    other = Fault(kind="sensor_delay", channel="rod_c_transverse", delay=1e-4)
    np.testing.assert_allclose(record(faults=[*both, other])[name][3:], axial[:-3])
    # a stiff resonance is a delay of 2 damping / w0 (and the sampled line's half a step of nothing)
    stiff = faulty("sensor_resonance", frequency=12e3, damping=0.6)
    late = faulty("sensor_delay", delay=1.2 / (2 * np.pi * 12e3))
    assert np.std(stiff - late) < 0.05 * np.std(late - clean[name]) + 0.02 * np.std(clean[name])
    fast = record(faults=[Fault(kind="timebase", rate_error=0.01)])
    np.testing.assert_allclose(fast["time"], clean["time"])
    moved = np.interp(clean["time"] / 1.01, clean["time"], clean["slider_position"])
    np.testing.assert_allclose(fast["slider_position"], moved, atol=1e-6)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: Plant(joint="D"), "'D'"),
        (lambda: Plant(effects={"rust": {}}), "rust"),
        (lambda: Plant(effects={"gravity": {"gravity_z": 1.0}}), "gravity_z"),
        (lambda: Plant(effects={"rod_flexibility": {"damping": 0.02}}), "damping"),  # it is damping_ratio
        (lambda: Plant(joint="both", effects={"second_clearance": {}}), "second_clearance"),
        (lambda: Plant(clearance=(1e-4, 2e-4)), "clearance"),
        (lambda: Plant(step=3e-6).run(1e-3), "step"),
        (lambda: ExtraForce(target="slider_x", argument="time", kind="ghost", size=1.0), "ghost"),
        (lambda: ExtraForce(target="slider_x", argument="time", kind="bump", size=1.0, width=0.0), "width"),
        (lambda: Fault(kind="sensor_gain", channel="rod", gain=2.0), "'rod'"),
        (lambda: Fault(kind="rust", channel="rod_c_axial"), "rust"),
        (lambda: record(record_start=0.0), "record_start"),
        (lambda: record(rate=30_000.0), "rate"),
        (lambda: record(channels=["rod"]), "rod"),
    ],
)
def test_wrong_settings_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        wrong()


def test_a_file_tells_nothing_of_its_origin(tmp_path):
    table = record(noise=0.01)
    write_parquet(table, tmp_path / "a.parquet")
    stored = pq.read_table(tmp_path / "a.parquet")
    assert stored.column_names == list(table)
    assert stored.schema.metadata is None
    recording = read(tmp_path / "a.parquet")
    assert recording.rate == pytest.approx(10_000.0)
    np.testing.assert_array_equal(recording.channel("rod_b_axial"), table["rod_b_axial"])


def test_the_plant_shares_no_code_with_the_engine():
    for path in Path(package.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            modules = []
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0
                modules = [str(node.module)]
            for module in modules:
                assert not module.startswith("clearance") or module.startswith("clearance.trial.plant"), path
