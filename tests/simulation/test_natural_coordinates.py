"""The paper's formulation against closed forms, SciPy on other coordinates, and its own algebra."""

import math

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.simulation import natural_coordinates as natural
from clearance.simulation.natural_coordinates import NaturalState, nominal_parameters, simulate
from tests.simulation import scipy_model
from tests.simulation.scipy_model import Machine, ideal_kinematics, rebound

CASES = {
    "none": {},
    "B": {"clearance_b": 1e-4},
    "C": {"clearance_c": 1e-4},
    "both": {"clearance_b": 1e-4, "clearance_c": 3e-4},
}
# Numbers far from the nominal ones: each enters the equations on its own.
AWKWARD = {"guide_offset": 0.012, "gravity": (1.3, -9.81), "crank_centre": 0.3, "rod_centre": 0.42}
LAWS = {
    "lankarani_nikravesh": (natural.lankarani_nikravesh_factor, (0.913, 0.805, 0.756)),
    "hunt_crossley": (natural.hunt_crossley_factor, (0.909, 0.780, 0.712)),
    "flores": (natural.flores_factor, (0.894, 0.704, 0.577)),
}


def speed(rpm):
    return rpm * math.pi / 30.0


@pytest.fixture(params=CASES)
def parameters(request):
    return nominal_parameters(**CASES[request.param], **AWKWARD)


@pytest.fixture
def state(parameters):
    """Independent coordinates and speeds at a general position, as (z, z')."""
    start = natural.start_at(parameters, 0.7, 40.0)
    random = np.random.default_rng(5)
    shift = random.uniform(-1e-4, 1e-4, start.coordinates.size)
    return start.coordinates + shift, start.speeds + random.uniform(-1.0, 1.0, start.speeds.size)


# --- algebra of equations (2)-(6) ------------------------------------------------------------------------


def test_position_problem_satisfies_the_constraints(parameters, state):
    q = natural.natural_positions(state[0], parameters.constants)
    np.testing.assert_allclose(natural.constraints(q, parameters.constants), 0.0, atol=1e-16)


def test_jacobian_is_the_derivative_of_the_constraints(parameters):
    q = np.random.default_rng(1).uniform(-0.1, 0.1, natural.COORDINATES)
    step = 1e-3 * np.eye(natural.COORDINATES)
    # The constraints are quadratic: a central difference is exact.
    columns = [
        (natural.constraints(q + s, parameters.constants) - natural.constraints(q - s, parameters.constants))
        / 2e-3
        for s in step
    ]
    jacobian = natural.constraint_jacobian(q, parameters.constants)
    np.testing.assert_allclose(jacobian, np.array(columns).T, atol=1e-13)


def test_transformation_lies_in_the_null_space_of_the_jacobian(parameters, state):
    z, z_dot = state
    q = natural.natural_positions(z, parameters.constants)
    transformation, _ = natural.velocity_transformation(q, z_dot, parameters.constants)
    assert transformation.shape == (natural.COORDINATES, parameters.degrees_of_freedom)
    assert np.linalg.matrix_rank(transformation) == parameters.degrees_of_freedom
    product = transformation.T @ natural.constraint_jacobian(q, parameters.constants).T
    np.testing.assert_allclose(product, 0.0, atol=1e-14)


def test_transformation_and_its_rate_are_the_derivatives_of_the_positions(parameters, state):
    z, z_dot = state
    small = 1e-6
    before, now, after = (
        natural.natural_positions(z + t * z_dot, parameters.constants) for t in (-small, 0.0, small)
    )
    velocities = [
        natural.velocity_transformation(q, z_dot, parameters.constants)[0] @ z_dot
        for q in (before, now, after)
    ]
    _, convective = natural.velocity_transformation(now, z_dot, parameters.constants)
    # Central differences: relative error (40 rad/s x 1e-6 s)² plus round-off.
    np.testing.assert_allclose((after - before) / (2 * small), velocities[1], rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(
        (velocities[2] - velocities[0]) / (2 * small), convective, rtol=1e-7, atol=1e-6
    )


def test_mass_matrix_gives_the_kinetic_energy_of_rigid_bodies():
    mass, inertia, length, centre = 0.21, 3.7e-4, 0.12, 0.37
    matrix = natural.link_mass_matrix(mass, inertia, length, centre)
    for angle, turn, v_x, v_y in np.random.default_rng(2).normal(size=(20, 4)):
        along, across = (
            length * np.array([np.cos(angle), np.sin(angle)]),
            np.array([-np.sin(angle), np.cos(angle)]),
        )
        first = np.array([v_x, v_y])
        ends = np.concatenate([first, first + turn * length * across])
        velocity = first + turn * centre * length * across
        energy = 0.5 * mass * velocity @ velocity + 0.5 * inertia * turn**2
        assert np.linalg.norm(along) == pytest.approx(length)
        assert 0.5 * ends @ matrix @ ends == pytest.approx(energy, rel=1e-12)


def test_mass_matrix_of_the_mechanism_is_constant_and_positive(parameters):
    matrix = parameters.mass_matrix
    np.testing.assert_array_equal(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix).min() > 0.0


def test_generalised_forces_do_the_work_of_the_applied_ones(parameters, state):
    z, z_dot = state
    p = parameters.constants
    q = natural.natural_positions(z, p)
    transformation, _ = natural.velocity_transformation(q, z_dot, p)
    q_dot = transformation @ z_dot
    force = natural.applied_forces(q, np.array([7.0, 11.0]), np.array([[0.6, 0.8], [0.0, 1.0]]), 3.0, p)

    def pair(start, end, share):
        return (1 - share) * q_dot[start : start + 2] + share * q_dot[end : end + 2]

    gravity = np.array(parameters.gravity)
    centres = (
        parameters.crank_mass * parameters.crank_centre * q_dot[0:2]
        + parameters.rod_mass * pair(natural.ROD_B_X, natural.ROD_C_X, parameters.rod_centre)
        + parameters.slider_mass * q_dot[6:8]
    )
    opening = 7.0 * (q_dot[0:2] - q_dot[2:4]) @ [0.6, 0.8] + 11.0 * (q_dot[4:6] - q_dot[6:8]) @ [0.0, 1.0]
    assert force @ q_dot == pytest.approx(gravity @ centres + 3.0 * z_dot[0] - opening, rel=1e-12)


def test_paper_scheme_on_natural_coordinates_drifts_and_this_one_does_not():
    """Equations (7)-(8) taken literally leave the constraints, which is why z is integrated."""
    parameters = nominal_parameters(reference_speed=speed(500), ramp_time=1e-9)
    p, mass, step = parameters.constants, parameters.mass_matrix, 1e-5
    q = natural.natural_positions(np.array([0.3]), p)
    z_dot = np.array([speed(500)])
    q_dot = natural.velocity_transformation(q, z_dot, p)[0] @ z_dot
    for _ in range(2000):
        z_dot = natural.independent_rows(q, p)[:1] @ q_dot
        transformation, convective = natural.velocity_transformation(q, z_dot, p)
        z_ddot = natural.independent_accelerations(mass, transformation, convective, np.zeros(8))
        q_dot += step * (transformation @ z_ddot + convective)
        q += step * q_dot
    literal = abs(natural.constraints(q, p)[0])
    ours = natural.constraints(
        natural.natural_positions(simulate(parameters, step, 0.02).end.coordinates, p), p
    )
    # Each step leaves the circle by (h ω r)²/2 at least: 3e-10 m² a step, of either sign.
    assert literal > 1e-8
    np.testing.assert_allclose(ours, 0.0, atol=1e-16)


# --- the ideal mechanism ---------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0.0, 0.02, -0.03])
def test_ideal_motion_equals_the_closed_form(offset):
    parameters = nominal_parameters(reference_speed=speed(800), guide_offset=offset)
    run = simulate(parameters, 1e-5, 0.6, sample_every=7)
    crank_acceleration = run.accelerations[:, 2] / parameters.crank_length
    exact = ideal_kinematics(run.crank_angle, run.crank_speed, crank_acceleration, offset=offset)
    # No truncation error: at a given crank motion the rest is algebra, so only round-off is left.
    np.testing.assert_allclose(run.rod_angle, exact["rod_angle"], atol=1e-13)
    np.testing.assert_allclose(run.rod_speed, exact["rod_speed"], atol=1e-11)
    np.testing.assert_allclose(run.slider_position, exact["slider_position"], atol=1e-14)
    np.testing.assert_allclose(run.slider_velocity, exact["slider_velocity"], atol=1e-12)
    np.testing.assert_allclose(run.accelerations, exact["channels"], atol=1e-9)
    assert run.crank_speed[-1] == pytest.approx(speed(800), rel=0.02)


def test_gravity_is_seen_by_every_accelerometer():
    parameters = nominal_parameters(reference_speed=speed(600), gravity=(0.5, -9.81), guide_offset=0.01)
    run = simulate(parameters, 1e-5, 0.1, sample_every=10)
    turning = {"crank": run.crank_angle, "rod": run.rod_angle}
    crank_acceleration = (
        run.accelerations[:, 2] + across(parameters, run.crank_angle)
    ) / parameters.crank_length
    exact = ideal_kinematics(run.crank_angle, run.crank_speed, crank_acceleration, offset=0.01)["channels"]
    for index, name in enumerate(natural.CHANNELS[:8]):
        angle = turning[name.split("_")[0]]
        seen = across(parameters, angle) if name.endswith("transverse") else along(parameters, angle)
        np.testing.assert_allclose(run.accelerations[:, index], exact[:, index] - seen, atol=1e-9)
    np.testing.assert_allclose(run.accelerations[:, 8], 9.81, atol=1e-12)
    np.testing.assert_allclose(run.accelerations[:, 9], exact[:, 9] - 0.5, atol=1e-9)


def along(parameters, angle):
    return parameters.gravity[0] * np.cos(angle) + parameters.gravity[1] * np.sin(angle)


def across(parameters, angle):
    return parameters.gravity[1] * np.cos(angle) - parameters.gravity[0] * np.sin(angle)


# --- against SciPy ---------------------------------------------------------------------------------------


@pytest.fixture(
    scope="module",
    params=["none", "B", "C", pytest.param("B, awkward", marks=pytest.mark.slow), "C, awkward"],
)
def scipy_run(request):
    """(parameters, times, SciPy's motion, its channels); the fast ramp makes contact hard within 40 ms."""
    joint, *awkward = request.param.split(", ")
    changes = {"hysteresis_factor": natural.flores_factor(0.8), **AWKWARD} if awkward else {}
    parameters = nominal_parameters(**CASES[joint], ramp_time=0.15, **changes)
    machine = Machine(
        joint,
        parameters.clearance_b + parameters.clearance_c,
        parameters.hysteresis_factor,
        offset=parameters.guide_offset,
        centres=(parameters.crank_centre, parameters.rod_centre),
        gravity=parameters.gravity,
        ramp=parameters.ramp_time,
    )
    times = 1e-4 * np.arange(400)
    coordinates, velocities, accelerations, touches = scipy_model.integrate(machine, times)
    assert bool(touches) == (joint != "none")
    motion = coordinates[:, [2, 5, 6]]  # crank angle, rod angle, slider position
    return parameters, times, motion, scipy_model.channels(machine, coordinates, velocities, accelerations)


def test_agreement_with_scipy_is_first_order(scipy_run):
    parameters, times, exact, exact_channels = scipy_run
    steps = np.array([1e-6, 5e-7, 2.5e-7])
    motions, errors, channel_errors = [], [], []
    for step in steps:
        run = simulate(parameters, step, 0.04, sample_every=round(1e-4 / step))
        np.testing.assert_allclose(run.time, times, atol=1e-12)
        motions.append(np.stack([run.crank_angle, run.rod_angle, run.slider_position], axis=-1))
        errors.append(np.sqrt(np.mean((motions[-1] - exact) ** 2, axis=0)))
        channel_errors.append(
            np.linalg.norm(run.accelerations - exact_channels) / np.linalg.norm(exact_channels)
        )
    slopes = np.diff(np.log(errors), axis=0) / np.diff(np.log(steps))[:, None]
    # Measured 0.977-1.006; second-order terms may bend it.
    np.testing.assert_allclose(slopes, 1.0, atol=0.05)
    # Without the first-order term 0.07 of it is left: where in a step a touch falls is chance.
    extrapolated = np.sqrt(np.mean((2.0 * motions[2] - motions[1] - exact) ** 2, axis=0))
    assert np.all(extrapolated < 0.15 * errors[2])
    # In contact the accelerations are oscillations whose phase is late by a time that falls with the step.
    assert channel_errors[2] < 0.55 * channel_errors[0]
    assert channel_errors[2] < 0.25


# --- contact ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("joint", ["B", "C"])
def test_rebound_of_a_single_impact(law, joint):
    """At dead centre, all in line: the slider (with the rod at B) strikes a crank that cannot yield."""
    factor_of, published = LAWS[law]
    for restitution, expected in zip((0.9, 0.72, 0.6), published, strict=True):
        factor = factor_of(restitution)
        parameters = nominal_parameters(
            **CASES[joint], hysteresis_factor=factor, proportional_gain=0.0, integral_gain=0.0
        )
        reach = parameters.crank_length + parameters.rod_length + 1e-4 - 1e-9
        start = NaturalState(np.array([0.0, 0.0, reach]), np.array([0.0, 0.0, 1.0]))
        run = simulate(parameters, 1e-8, 2e-4, start=start)
        index = "BC".index(joint)
        assert run.contact_force[:, index].max() > 1e3
        assert run.penetration[-1, index] < 0.0
        assert run.approach_speed[:, index].max() == pytest.approx(1.0, rel=1e-6)
        ratio = -run.slider_velocity[-1]
        # About 5000 steps an impact; measured 2e-10. The published numbers have three digits.
        assert ratio == pytest.approx(rebound(factor), abs=1e-8)
        assert ratio == pytest.approx(expected, abs=6e-4)


@pytest.mark.parametrize("law", LAWS)
def test_restitution_of_one_is_elastic(law):
    assert LAWS[law][0](1.0) == 0.0
    assert rebound(0.0) == 1.0


def energy(parameters, state):
    """Kinetic, elastic and potential energy of a state [J]."""
    p = parameters.constants
    q = natural.natural_positions(state.coordinates, p)
    q_dot = natural.velocity_transformation(q, state.speeds, p)[0] @ state.speeds
    total = 0.5 * q_dot @ parameters.mass_matrix @ q_dot
    total -= natural.applied_forces(q, np.zeros(2), np.zeros((2, 2)), 0.0, p) @ q
    for journal, bearing, clearance, stiffness in (
        (natural.CRANK_B_X, natural.ROD_B_X, p.clearance_b, p.stiffness_b),
        (natural.ROD_C_X, natural.SLIDER_X, p.clearance_c, p.stiffness_c),
    ):
        depth = max(0.0, np.linalg.norm(q[journal : journal + 2] - q[bearing : bearing + 2]) - clearance)
        total += stiffness * depth**2.5 / 2.5
    return total


@pytest.mark.parametrize("case", CASES)
def test_energy_is_kept_without_drive_and_hysteresis(case):
    elastic = nominal_parameters(
        **CASES[case], **AWKWARD, hysteresis_factor=0.0, proportional_gain=0.0, integral_gain=0.0
    )
    start = natural.start_at(elastic, 0.3, 60.0)
    initial, errors = energy(elastic, start), []
    for step in (1e-6, 2.5e-7):
        run = simulate(elastic, step, 0.03, sample_every=10, start=start)
        assert np.any(run.contact_force > 0.0) == (case != "none")
        errors.append(abs(energy(elastic, run.end) - initial) / initial)
    # First order, measured 3e-6 to 2e-5 at the finer step.
    assert errors[1] < 4e-5
    assert 3.0 < errors[0] / errors[1] < 8.0


@pytest.mark.parametrize("case", ["B", "C", "both"])
def test_hysteresis_takes_energy_away(case):
    parameters = nominal_parameters(
        **CASES[case], hysteresis_factor=natural.flores_factor(0.6), proportional_gain=0.0, integral_gain=0.0
    )
    start = natural.start_at(parameters, 0.3, 60.0)
    run = simulate(parameters, 1e-6, 0.05, start=start, sample_every=100)
    assert energy(parameters, run.end) < 0.999 * energy(parameters, start)


def test_memory_of_a_contact():
    remembered = natural.remembered_approach_speed
    assert remembered(-1e-9, 3.0, 2.0, 1e-3) == 0.0
    assert remembered(0.0, 3.0, 2.0, 1e-3) == 0.0
    assert remembered(1e-9, 3.0, 0.0, 1e-3) == 3.0
    assert remembered(1e-9, -3.0, 0.0, 1e-3) == 1e-3
    assert remembered(1e-9, 1e-5, 0.0, 1e-3) == 1e-3
    assert remembered(1e-9, -3.0, 2.0, 1e-3) == 2.0


def test_a_contact_never_pulls():
    assert natural.normal_force(1e-6, -100.0, 1.0, 1.5e11, 1.5, 0.5) == 0.0
    assert natural.normal_force(-1e-6, 1.0, 1.0, 1.5e11, 1.5, 0.5) == 0.0
    assert natural.normal_force(1e-6, 0.0, 1.0, 1.5e11, 1.5, 0.5) == pytest.approx(150.0)


def test_stiffness_of_the_nominal_contact():
    assert natural.hertz_stiffness(1e-4) == pytest.approx(1.5e11, rel=0.03)  # docs/mechanism.md: "about"


# --- use -------------------------------------------------------------------------------------------------


def test_step_follows_the_shared_convention():
    """Forces at n, then speeds, then positions with the new speeds; the drive integral with the old ones."""
    parameters = nominal_parameters(clearance_b=2e-4, clearance_c=1e-4)
    step = 1e-4
    start = natural.start_at(parameters, 0.4, 50.0)
    run = simulate(parameters, step, 2 * step, start=start)
    assert run.time.tolist() == [0.0, step]
    assert run.crank_speed[0] == pytest.approx(50.0, rel=1e-14)
    assert run.drive_torque[0] == pytest.approx(5.0 * -50.0, rel=1e-14)
    crank_acceleration = run.accelerations[0, 2] / parameters.crank_length
    assert run.crank_speed[1] == pytest.approx(50.0 + step * crank_acceleration, rel=1e-14)
    assert run.crank_angle[1] == pytest.approx(0.4 + step * run.crank_speed[1], rel=1e-14)
    assert run.slider_velocity[1] == pytest.approx(
        run.slider_velocity[0] + step * run.accelerations[0, 9], rel=1e-14
    )
    second_error = parameters.reference_speed * step / 0.5 - run.crank_speed[1]
    assert run.drive_torque[1] == pytest.approx(5.0 * second_error + 200.0 * step * -50.0, rel=1e-14)
    assert run.end.drive_integral == pytest.approx(step * (-50.0 + second_error), rel=1e-14)


def test_sampling_only_selects_rows():
    parameters = nominal_parameters(clearance_c=1e-4)
    every, tenth = simulate(parameters, 1e-5, 0.02), simulate(parameters, 1e-5, 0.02, sample_every=10)
    assert tenth.time.size == 200
    for name in ("time", "crank_angle", "accelerations", "contact_force", "penetration", "drive_torque"):
        np.testing.assert_array_equal(getattr(tenth, name), getattr(every, name)[::10])


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"rod_length": 0.05}, "rod_length = 0.05: must be > crank"),
        ({"guide_offset": 0.07001}, "rod_length = 0.12: must be > crank [+] offset = 0.12001"),
        ({"crank_mass": -0.3}, "crank_mass = -0.3"),
        ({"rod_inertia": -1e-9}, "rod_inertia = -1e-09"),
        ({"rod_centre": 1.2}, "rod_centre = 1.2"),
        ({"clearance_b": -1e-4, "stiffness_b": 1e11}, "clearance_b = -0.0001"),
        ({"clearance_c": 1e-4}, "stiffness_c = 0.0"),
        ({"ramp_time": 0.0}, "ramp_time = 0.0"),
        ({"gravity": (0.0, math.nan)}, "gravity"),
        ({"reference_speed": math.inf}, "reference_speed = inf"),
    ],
)
def test_impossible_parameters_are_refused(change, named):
    with pytest.raises(InputError, match=named):
        natural.NaturalParameters(**change)


@pytest.mark.parametrize("change", [{"step": 0.0}, {"duration": 1e-9}, {"sample_every": 0}])
def test_impossible_runs_are_refused(change):
    with pytest.raises(InputError, match=next(iter(change))):
        simulate(nominal_parameters(), **{"step": 1e-5, "duration": 1e-3, **change})


def test_start_of_another_mechanism_is_refused():
    with pytest.raises(InputError, match="start"):
        simulate(
            nominal_parameters(), 1e-5, 1e-3, start=natural.start_at(nominal_parameters(clearance_c=1e-4))
        )


@pytest.mark.parametrize("stiffness", [1e40, 1e200, 1e308])
def test_non_finite_motion_stops_with_its_time(stiffness):
    parameters = nominal_parameters(clearance_c=1e-4, stiffness_c=stiffness)
    with pytest.raises(FloatingPointError, match=r"t = 0\.00"):
        simulate(parameters, 1e-5, 0.1)
