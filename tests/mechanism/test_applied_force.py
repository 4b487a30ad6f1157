"""The table of a force of free form, and what it refuses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from clearance.compilation import entry
from clearance.errors import InputError
from clearance.lanes import WIDTH, get, put
from clearance.mechanism.applied_force import (
    _FUNCTIONS,
    DIRECTIONS,
    Argument,
    TabulatedForce,
    choose_argument,
    look_up,
    looked_up,
    shares,
)
from clearance.mechanism.parameters import TABLE_KNOTS, Parameter
from clearance.mechanism.slider_crank import SliderCrank


def parameters(**settings):
    return SliderCrank(force=TabulatedForce(**settings)).parameters()


@entry
def look_up_row(p, x, out):
    put(out, 0, look_up(p, get(x, 0)))


@entry
def chosen_argument(p, x):
    return choose_argument(p, x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11], x[12])


VALUES = st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=TABLE_KNOTS)
START, SPACING = st.floats(-5.0, 5.0), st.floats(0.01, 3.0)
ARGUMENT, ANGLE = st.floats(-60.0, 60.0), st.floats(-300.0, 300.0)


@given(values=VALUES, start=START, spacing=SPACING, argument=ARGUMENT)
@settings(deadline=None, max_examples=200)
def test_a_table_is_linear_between_its_knots_and_constant_beyond_them(values, start, spacing, argument):
    p = parameters(argument="slider_velocity", start=start, spacing=spacing, values=values)
    knots = start + spacing * np.arange(len(values))
    # rounding of the place between two knots, times the largest step of the table
    assert look_up(p, argument) == pytest.approx(np.interp(argument, knots, values), abs=1e-9)


@pytest.mark.parametrize("between", ["linear", "cubic"])
@pytest.mark.parametrize("values", [(3.0,), (1.0, 4.0), (0.0, 2.0, 7.0)])
def test_a_table_over_a_contacts_force_goes_on_straight(values, between):
    p = parameters(argument="force_c", start=10.0, spacing=20.0, values=values, interpolation=between)
    last, slope = 10.0 + 20.0 * (len(values) - 1), (values[-1] - values[max(len(values) - 2, 0)]) / 20.0
    for beyond in (0.0, 5.0, 900.0):
        expected = values[-1] + slope * beyond
        assert look_up(p, last + beyond) == pytest.approx(expected, abs=1e-9)
        own = shares(np.array([(last + beyond - 10.0) / 20.0]), len(values), False, between, straight=True)
        assert (own @ values)[0] == pytest.approx(expected, abs=1e-9)
    assert look_up(p, -50.0) == pytest.approx(values[0], abs=1e-9)


@given(values=VALUES, start=START, period=SPACING, time=ARGUMENT)
@settings(deadline=None, max_examples=100)
def test_a_table_over_time_repeats_after_its_period(values, start, period, time):
    p = parameters(argument="time", start=start, values=values, period=period)
    knots = start + period / len(values) * np.arange(len(values))
    assert look_up(p, time) == pytest.approx(np.interp(time, knots, values, period=period), abs=1e-7)
    assert looked_up(p, np.array([time, -time])) == pytest.approx(
        [look_up(p, time), look_up(p, -time)], abs=1e-7
    )


@given(values=VALUES, start=START, period=SPACING, share=st.floats(0.0, 1.0), time=ARGUMENT)
@settings(deadline=None, max_examples=100)
def test_a_force_that_is_on_and_off_goes_back_the_way_it_came(values, start, period, share, time):
    spacing = 0.4 * period / len(values)
    there = spacing * np.arange(len(values))
    returns = 2.0 * there[-1] + share * (period - 2.0 * there[-1])
    p = parameters(
        argument="time", start=start, spacing=spacing, values=values, period=period, returns=returns
    )
    knots, forces = np.append(there, returns - there[::-1]), [*values, *values[::-1]]
    expected = np.interp((time - start) % period, knots, forces)  # and off until the period is over
    assert look_up(p, time) == pytest.approx(expected, abs=1e-6)
    assert looked_up(p, np.array([time]))[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"argument": "time", "period": 0.1, "returns": 0.05}, "returns = 0.05 .* spacing"),
        ({"argument": "slider_velocity", "spacing": 1.0, "returns": 0.05}, "returns = 0.05 .* repeats"),
        ({"argument": "time", "period": 0.1, "spacing": 0.01, "returns": 0.11}, "returns = 0.11 is outside"),
        ({"argument": "time", "period": 0.1, "spacing": 0.01, "returns": 0.01}, "returns = 0.01 is outside"),
    ],
)
def test_what_is_on_and_off_is_so_within_its_period(settings, complaint):
    with pytest.raises(InputError, match=complaint):
        TabulatedForce(values=(1.0, 2.0), **settings)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"argument": "time", "period": 0.0}, "period"),
        ({"argument": "slider_velocity", "spacing": 1.0, "period": 0.1}, "slider_velocity"),
        ({"argument": "time", "spacing": 0.01, "period": 0.1}, "spacing"),
    ],
)
def test_a_period_belongs_to_time_and_takes_no_spacing(settings, complaint):
    with pytest.raises(InputError, match=complaint):
        TabulatedForce(values=(1.0, 2.0), **settings)


@given(values=VALUES, start=START, angle=ANGLE)
@settings(deadline=None, max_examples=200)
def test_a_table_over_the_crank_angle_repeats_every_turn(values, start, angle):
    p = parameters(argument="crank_angle", start=start, values=values)
    knots = start + 2.0 * np.pi / len(values) * np.arange(len(values))
    expected = np.interp(angle, knots, values, period=2.0 * np.pi)
    assert look_up(p, angle) == pytest.approx(expected, abs=1e-9)
    assert look_up(p, angle + 20.0 * np.pi) == pytest.approx(look_up(p, angle), abs=1e-9)


@given(values=VALUES.filter(lambda values: len(values) > 1), start=START, spacing=SPACING, argument=ARGUMENT)
@settings(deadline=None, max_examples=200)
def test_a_spline_is_the_natural_one_and_constant_beyond_its_knots(values, start, spacing, argument):
    p = parameters(
        argument="slider_velocity", start=start, spacing=spacing, values=values, interpolation="cubic"
    )
    knots = start + spacing * np.arange(len(values))
    spline = CubicSpline(knots, values, bc_type="natural")
    expected = spline(np.clip(argument, knots[0], knots[-1]))
    assert look_up(p, argument) == pytest.approx(expected, abs=1e-7)
    own = shares(np.array([(argument - start) / spacing]), len(values), False, "cubic")
    assert own.sum() == pytest.approx(1.0, abs=1e-9)
    assert (own @ values)[0] == pytest.approx(expected, abs=1e-7)


@given(values=VALUES, start=START, angle=ANGLE)
@settings(deadline=None, max_examples=200)
def test_a_spline_over_the_crank_angle_is_periodic(values, start, angle):
    p = parameters(argument="crank_angle", start=start, values=values, interpolation="cubic")
    spacing = 2.0 * np.pi / len(values)
    knots = start + spacing * np.arange(-3 * len(values), 3 * len(values) + 1)
    forces = np.tile(values, 7)[: len(knots)]
    expected = CubicSpline(knots, forces, bc_type="periodic")((angle - start) % (2.0 * np.pi) + start)
    assert look_up(p, angle) == pytest.approx(expected, abs=1e-7)
    own = shares(np.array([(angle - start) / spacing]), len(values), True, "cubic")
    assert (own @ values)[0] == pytest.approx(expected, abs=1e-7)


def test_a_spline_follows_a_harmonic_of_four_knots_a_period():
    """The fourth power of what aliases, (1/3)^4, against its square, on the way from knot to knot."""
    knots, angle = 2.0 * np.pi * np.arange(24) / 24, np.linspace(0.0, 2.0 * np.pi, 997)
    for between, most in (("linear", 0.32), ("cubic", 0.02)):
        own = shares(angle / knots[1], 24, True, between)
        best = np.linalg.lstsq(own, np.cos(6.0 * angle), rcond=None)[0]
        left = np.abs(own @ best - np.cos(6.0 * angle)).max()
        assert 0.5 * most < left < most, (between, left)


def test_lanes_with_tables_of_their_own_look_up_what_a_single_run_does():
    generator = np.random.default_rng(3)
    columns, arguments = [], np.zeros((1, WIDTH))
    for lane in range(WIDTH):
        over_angle = lane % 2 == 0
        columns.append(
            parameters(
                argument="crank_angle" if over_angle else "slider_velocity",
                spacing=None if over_angle else 0.3,
                start=generator.normal(),
                values=list(generator.normal(size=1 + lane)),
                interpolation="cubic" if lane % 3 == 0 else "linear",
            )
        )
        arguments[0, lane] = 10.0 * generator.normal()
    p, out = np.ascontiguousarray(np.array(columns).T), np.zeros((1, WIDTH))
    look_up_row(p, arguments, out)
    one = [look_up(p[:, lane].copy(), arguments[0, lane]) for lane in range(WIDTH)]
    np.testing.assert_allclose(out[0], one, rtol=0, atol=1e-13)


@pytest.mark.parametrize("argument", Argument)
def test_each_argument_has_its_number(argument):
    name = argument.name.lower()
    p = parameters(argument=name, spacing=None if name == "crank_angle" else 1.0)
    assert chosen_argument(p, np.arange(100.0, 113.0)) == 100.0 + argument


def test_each_direction_has_a_constant_and_a_weight_in_the_same_order():
    names = [f"{body.removeprefix('joint_')}_{direction}".upper() for body, direction in DIRECTIONS]
    for index, name in enumerate(names):
        assert Parameter[f"FORCE_{name}"] == Parameter.FORCE_CRANK_TORQUE + index
        assert Parameter[f"TABLE_{name}"] == Parameter.TABLE_CRANK_TORQUE + index
    assert Parameter.FORCE_CRANK_TORQUE + len(DIRECTIONS) == Parameter.TABLE_CRANK_TORQUE
    last = Parameter[f"TABLE_VALUE_{_FUNCTIONS - 1}"]
    assert last == Parameter.TABLE_VALUE_0 + _FUNCTIONS - 1 == max(Parameter)
    for index, (body, direction) in enumerate(DIRECTIONS):
        p = parameters(body=body, direction=direction, values=[3.0])
        weights = p[Parameter.TABLE_CRANK_TORQUE : Parameter.TABLE_ARGUMENT]
        np.testing.assert_array_equal(weights, np.eye(len(DIRECTIONS))[index])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"body": "piston"}, r"body = 'piston' is not one of crank, rod, slider, frame, joint_b, joint_c"),
        ({"body": "crank", "direction": "x"}, r"direction = 'x' is not one of torque"),
        ({"argument": "phase"}, r"argument = 'phase' is not one of crank_angle, .*time"),
        ({"interpolation": "smooth"}, r"interpolation = 'smooth' is not one of linear, cubic"),
        ({"values": []}, r"values has 0 numbers, not 1 to 48"),
        ({"values": [1.0] * 49}, r"values has 49 numbers"),
        ({"values": [1.0, float("nan")]}, r"values = nan"),
        ({"spacing": 0.1}, r"spacing = 0\.1 .*turn or period.*null"),
        ({"argument": "time", "values": [1.0, 2.0]}, r"spacing = None.*time"),
        ({"argument": "time", "spacing": -1.0, "values": [1.0, 2.0]}, r"spacing = -1 is outside \(0"),
    ],
)
def test_a_table_that_means_nothing_is_refused(wrong, message):
    with pytest.raises(InputError, match=message):
        TabulatedForce(**wrong)
