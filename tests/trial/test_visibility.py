"""The detection threshold: what a refit of state, clearance and speed can explain does not count."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.trial.chart import SIZE, Z, chart, instant_of
from clearance.trial.plant import Instant, Plant
from clearance.trial.visibility import Scene, later, response, unexplained

NOMINAL = Plant(joint="C", clearance=2e-4, speed_rpm=700.0, ramp=0.0)
MACHINES = {
    "one gap": ("C", {}),
    "both gaps, a frame that moves, a rod that bends": (
        "B", {"flexible_base": {}, "second_clearance": {}, "rod_flexibility": {}}),
    "a loose guide, off the line, an unbalanced rod": (
        "C",
        {"guide_clearance": {}, "rod_inertia": {"com_shift": 0.004}, "slider_offset": {"offset": 0.003}}),
}  # fmt: skip


@pytest.mark.parametrize("name", MACHINES)
def test_a_motion_that_is_interrupted_goes_on_as_if_it_was_not(name):
    joint, effects = MACHINES[name]
    plant = Plant(joint=joint, ramp=0.0, effects=effects)
    begin = Instant(0.0, plant.start(0.4, 700.0), np.zeros(2))
    whole, _ = plant.go_on(begin, 0.045)
    first, instant = plant.go_on(begin, 0.04)
    rest, _ = plant.go_on(instant, 0.005)
    np.testing.assert_array_equal(np.concatenate([first.signals, rest.signals]), whole.signals)
    z = chart(plant, instant.state)
    charted = instant_of(plant, instant.time, z, instant.memory)
    np.testing.assert_allclose(charted.state, instant.state, atol=1e-12)
    np.testing.assert_array_equal(charted.memory, instant.memory)


def test_the_same_state_of_another_machine_presses_no_journal():
    """A guide line moved by 3 mm: the bodies lie elsewhere, the gap is the same."""
    other = replace(NOMINAL, effects={"slider_offset": {"offset": 0.003}})
    z = np.zeros(SIZE)
    z[Z.CRANK], z[Z.GAP_C_X], z[len(Z) + Z.CRANK] = 0.7, 2e-4, 70.0
    for plant in (NOMINAL, other):
        back = chart(plant, instant_of(plant, 0.0, z, np.zeros(2)).state)
        np.testing.assert_allclose(back, z, atol=1e-12)


@pytest.fixture(scope="module")
def scenes():
    instant = Instant(0.0, NOMINAL.start(0.3, 700.0), np.zeros(2))
    found = []
    for _ in range(6):
        _, instant = NOMINAL.go_on(instant, 0.03)
        found.append(Scene(0, instant.time, chart(NOMINAL, instant.state), instant.memory))
    return found


def visible(scenes, other, **settings):
    spread = np.where(np.arange(10) >= 2, 100.0, 0.0)
    changes = [response(other, scene) - response(NOMINAL, scene) for scene in scenes]
    return unexplained(scenes, changes, [NOMINAL], spread, **settings), changes


def test_a_force_shows_in_proportion_to_its_size(scenes):
    strong, _ = visible(scenes, replace(NOMINAL, effects={"slider_spring": {"stiffness": 20.0}}))
    weak, _ = visible(scenes, replace(NOMINAL, effects={"slider_spring": {"stiffness": 10.0}}))
    assert strong == pytest.approx(2.0 * weak, rel=0.02)
    # 20 N/m over 5 cm on 0.14 kg (and the rod's share): some 3 to 7 m/s², of which 3 % of 100 m/s² is 1
    assert 0.2 < strong < 2.5


def test_what_can_be_refitted_does_not_show(scenes):
    """The drive's speed, the clearance and the state; but the clearance only if it is refitted."""
    for other in (replace(NOMINAL, speed_rpm=700.02), replace(NOMINAL, clearance=2e-4 * (1 + 1e-6))):
        left, changes = visible(scenes, other)
        raw = max(np.sqrt(np.mean(np.square(changes), axis=(0, 1)))) / 3.0
        assert raw > 1e-3
        assert left < 0.02 * raw
    moved = []
    for scene in scenes:
        state = scene.state.copy()
        state[Z.CRANK] += 1e-6
        state[len(Z) + Z.GAP_C_Y] += 1e-5
        moved.append(response(NOMINAL, replace(scene, state=state)) - response(NOMINAL, scene))
    spread = np.full(10, 100.0)
    raw = max(np.sqrt(np.mean(np.square(moved), axis=(0, 1)))) / 3.0
    assert unexplained(scenes, moved, [NOMINAL], spread) < 0.02 * raw


def test_a_change_of_speed_alone_is_refitted_at_all_instants_together(scenes):
    """One change of the speed for all: how much each instant shows of it counts."""
    faster = replace(NOMINAL, speed_rpm=NOMINAL.speed_rpm * (1.0 + 1e-5))
    changes = [response(faster, scene) - response(NOMINAL, scene) for scene in scenes]
    spread = np.full(10, 100.0)
    raw = max(np.sqrt(np.mean(np.square(changes), axis=(0, 1)))) / 3.0
    assert unexplained(scenes, changes, [NOMINAL], spread) < 2e-3 * raw


def test_a_slow_clock_shows_what_was_later():
    times = np.arange(1000) / 1e5
    signals = np.stack([np.sin(300.0 * times), times], axis=1)
    found = later(signals, 0.01)[:900]
    np.testing.assert_allclose(found[:, 1], 1.01 * times[:900], atol=1e-12)
    np.testing.assert_allclose(found[:, 0], np.sin(303.0 * times[:900]), atol=1e-5)
