"""Unknowns of a node: how a change of them is applied, against its own linearisation."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.shooting.chart import Chart
from clearance.mechanism.drive import DirectCurrentMotor
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.guide import LooseGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.link import FlexibleRod
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.layout import STATES, State
from clearance.simulation.shooting import ECCENTRICITY_B, ECCENTRICITY_C

BOTH = SliderCrank(joint_b=Joint(2e-4), joint_c=Joint(3e-4))
MACHINES = {
    "B": SliderCrank(joint_b=Joint(2e-4)),
    "C": SliderCrank(joint_c=Joint(3e-4)),
    "both": BOTH,
    "loose guide": replace(BOTH, guide=LooseGuide()),
    "everything": replace(BOTH, guide=LooseGuide(), frame=FlexibleFrame(), link=FlexibleRod()),
    "motor": SliderCrank(joint_c=Joint(3e-4), drive=DirectCurrentMotor()),
    "ideal": SliderCrank(),
}
COUNT = 40


def random_nodes(distance, seed=0):
    """Nodes whose journals lie ``distance`` clearances from the centres, moving."""
    rng = np.random.default_rng(seed)
    nodes = rng.normal(size=(COUNT, STATES))
    nodes[:, [State.MEMORY_B, State.MEMORY_C]] = rng.uniform(0.1, 0.5, (COUNT, 2))
    for i, j in (ECCENTRICITY_B, ECCENTRICITY_C):
        angle = rng.uniform(0.0, 2.0 * np.pi, COUNT)
        nodes[:, i], nodes[:, j] = distance * np.cos(angle), distance * np.sin(angle)
        nodes[:, [i + 10, j + 10]] = rng.normal(size=(COUNT, 2)) * 1e3
    return nodes


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("distance", [0.0, 0.3, 0.9, 1.001])
def test_a_change_is_to_first_order_what_the_bases_say(name, distance):
    chart, nodes = Chart.of(MACHINES[name]), random_nodes(distance)
    bases = chart.bases(nodes)
    for unknown in range(len(chart.rows)):
        change = np.zeros((COUNT, len(chart.rows)))
        change[:, unknown] = 1e-3
        difference = chart.moved(nodes, change) - chart.moved(nodes, -change)
        slope = difference[:, chart.rows] / 2e-3 / chart.units
        # central differences: rounding of a node of size 1e3 (rates) in units of 1e-4/3e-4
        np.testing.assert_allclose(slope, bases[:, :, unknown], rtol=1e-6, atol=1e-6)
        others = np.setdiff1d(np.arange(STATES), chart.rows)
        assert not difference[:, others].any()


@pytest.mark.parametrize("name", MACHINES)
def test_no_change_is_no_change(name):
    chart, nodes = Chart.of(MACHINES[name]), random_nodes(1.001)
    moved = chart.moved(nodes, np.zeros((COUNT, len(chart.rows))))
    np.testing.assert_array_equal(moved, nodes)
    assert moved is not nodes


@pytest.mark.parametrize("name", ["B", "C", "both"])
@pytest.mark.parametrize("distance", [0.6, 1.001])
def test_along_the_surface_the_distance_from_the_centre_stays(name, distance):
    chart, nodes = Chart.of(MACHINES[name]), random_nodes(distance)
    rng = np.random.default_rng(4)
    change = np.zeros((COUNT, len(chart.rows)))
    for _, j in chart.journals:
        change[:, j] = rng.normal(size=COUNT) * 0.3 / chart.units[j]  # 0.3 rad
    moved = chart.moved(nodes, change)
    for i, j in chart.journals:
        rows = chart.rows[[i, j]]
        np.testing.assert_allclose(np.hypot(*moved[:, rows].T), distance, rtol=4e-16)
        assert np.abs(moved[:, rows] - nodes[:, rows]).max() > 0.1
        # the journal's velocity turns with it: neither faster nor towards the bearing
        before, after = nodes[:, rows + 10], moved[:, rows + 10]
        np.testing.assert_allclose(np.hypot(*after.T), np.hypot(*before.T), rtol=1e-12)
        across = (nodes[:, rows] * before).sum(axis=1)
        np.testing.assert_allclose((moved[:, rows] * after).sum(axis=1), across, rtol=1e-9, atol=1e-9)


def test_across_the_surface_the_direction_stays():
    chart, nodes = Chart.of(MACHINES["C"]), random_nodes(1.001)
    i, j = chart.journals[0]
    change = np.zeros((COUNT, len(chart.rows)))
    change[:, i] = 1e-4 / chart.units[i]
    place, moved = (x[:, chart.rows[[i, j]]] for x in (nodes, chart.moved(nodes, change)))
    np.testing.assert_allclose(moved, place * (1.0 + 1e-4 / 1.001), rtol=1e-12)


def test_a_journal_near_the_centre_moves_straight():
    chart, nodes = Chart.of(MACHINES["C"]), random_nodes(0.1)
    i, j = chart.journals[0]
    change = np.zeros((COUNT, len(chart.rows)))
    change[:, [i, j]] = np.array([0.2, -0.1]) / chart.units[[i, j]]
    rows = chart.rows[[i, j]]
    np.testing.assert_allclose(chart.moved(nodes, change)[:, rows], nodes[:, rows] + [0.2, -0.1])


def test_a_journal_turns_by_no_more_than_a_radian():
    chart, nodes = Chart.of(MACHINES["C"]), random_nodes(1.0)
    i, j = chart.journals[0]
    change = np.zeros((COUNT, len(chart.rows)))
    change[:, j] = 50.0 / chart.units[j]
    place, moved = (x[:, chart.rows[[i, j]]] for x in (nodes, chart.moved(nodes, change)))
    np.testing.assert_allclose((place * moved).sum(axis=1), np.cos(1.0), rtol=1e-12)


def test_memories_stay_at_or_above_zero():
    chart, nodes = Chart.of(MACHINES["both"]), random_nodes(1.001)
    change = np.random.default_rng(5).normal(size=(COUNT, len(chart.rows))) * 1e3
    memories = chart.moved(nodes, change)[:, [State.MEMORY_B, State.MEMORY_C]]
    assert (memories >= 0.0).all()
    assert (memories == 0.0).any()
    assert (memories > 0.0).any()


def test_an_ideal_joint_has_no_journal_and_a_motor_no_integral():
    assert [len(Chart.of(MACHINES[name]).journals) for name in ("ideal", "B", "C", "both")] == [0, 1, 1, 2]
    assert State.DRIVE_INTEGRAL in Chart.of(MACHINES["C"]).rows
    assert State.DRIVE_INTEGRAL not in Chart.of(MACHINES["motor"]).rows
    rows = Chart.of(MACHINES["everything"]).rows
    assert len(set(rows)) == len(rows)
    coordinates = {
        State.CRANK_ANGLE, *ECCENTRICITY_B, *ECCENTRICITY_C, State.SLIDER_Y, State.SLIDER_ANGLE,
        State.FRAME_X, State.FRAME_Y, State.ROD_MODE,
    }  # fmt: skip
    assert coordinates == {int(row) for row in rows if row < 10}
    assert {int(row) for row in rows if 10 <= row < 20} == {row + 10 for row in coordinates}


def test_a_unit_is_the_same_length_whatever_the_clearance():
    small, large = (Chart.of(SliderCrank(joint_c=Joint(c))) for c in (1e-5, 1e-3))
    for attribute in ("units", "noise"):
        ratio = getattr(small, attribute) / getattr(large, attribute)
        i, j = small.journals[0]
        expected = np.ones(len(ratio))
        expected[[i, i + 1, j, j + 1]] = 100.0
        np.testing.assert_allclose(ratio, expected)


def test_a_guess_in_contact_is_surer_across_the_surface_than_one_apart():
    chart = Chart.of(MACHINES["C"])
    i, j = chart.journals[0]
    apart, touching = (chart.doubt(random_nodes(d)[0]) for d in (0.7, 1.001))
    assert touching[i] < apart[i]
    assert touching[j] == apart[j]
    assert (touching > 0.0).all()
    assert (chart.reach > 0.0).all()
    places = chart.rows < 10  # of the state, before its rates
    assert (chart.units >= chart.noise).all()
    assert (chart.units[places] > chart.noise[places]).all()


def test_rails_lie_along_the_guide_line_wherever_it_is_and_move_with_the_frame():
    narrow, wide = (
        Chart.of(replace(BOTH, guide=LooseGuide(gap=gap), guide_offset=offset))
        for gap, offset in ((1e-4, 5e-3), (1.2e-4, 6e-3))
    )
    nodes = np.zeros((2, STATES))
    nodes[:, State.FRAME_Y] = 0.0, 3e-5
    nodes[:, State.SLIDER_Y] = 5.1e-3, 5.13e-3
    np.testing.assert_allclose(narrow.pressed(nodes), 1.0)
    carried = wide.carried(nodes, narrow)
    np.testing.assert_allclose(wide.pressed(carried), 1.0)
    np.testing.assert_allclose(carried[:, State.SLIDER_Y], [6.12e-3, 6.15e-3])


def test_a_slider_lies_as_near_to_other_rails_as_to_its_own():
    narrow, wide = (Chart.of(replace(BOTH, guide=LooseGuide(gap=gap))) for gap in (1e-4, 1.2e-4))
    guide = LooseGuide()
    nodes = np.zeros((3, STATES))
    nodes[:, State.SLIDER_Y] = 0.0, 1e-4, 5e-5
    nodes[:, State.SLIDER_ANGLE] = 0.0, 0.0, -0.5e-4 / guide.shoe_half_length
    np.testing.assert_allclose(narrow.pressed(nodes), [0.0, 1.0, 1.0])  # in the middle; flat; with one end
    carried = wide.carried(nodes, narrow)
    np.testing.assert_allclose(wide.pressed(carried), [0.0, 1.0, 1.0])
    np.testing.assert_allclose(carried[1:, State.SLIDER_Y], [1.2e-4, 6e-5])
    others = [row for row in range(STATES) if row not in (State.SLIDER_Y, State.SLIDER_ANGLE)]
    np.testing.assert_array_equal(carried[:, others], nodes[:, others])
    ideal = Chart.of(BOTH)
    np.testing.assert_array_equal(ideal.carried(nodes, ideal), nodes)
    np.testing.assert_array_equal(ideal.pressed(nodes), 0.0)
