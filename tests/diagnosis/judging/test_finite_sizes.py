"""Sizes of effects without a derivative at "off": the ladder finds them, noisy recordings show them."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.judging.detectability import STANDARD_ERRORS, follower_on_path
from clearance.diagnosis.judging.finite_sizes import (
    LEFT,
    Ladder,
    highest,
    left_by_sensor_set,
    limits_of_sensors,
    rungs,
    without_derivative,
)
from clearance.diagnosis.judging.nominal_map import CLEARANCES, SPEEDS, nominal_map
from clearance.diagnosis.searching.significance import CALM
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.settle import settle
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import ACCELERATIONS, SensorSet

CLEARANCE, RPM = 3e-4, 700.0
MACHINE = SliderCrank(joint_c=Joint(CLEARANCE))
SETTING = Setting(MACHINE, "C")
ROD = SensorSet("rod", ACCELERATIONS[4:8])
SLIDER = SensorSet("slider", ("slider_horizontal",))


def structural(*names):
    groups = gather(load_effects(list(names) or "all", []), MACHINE, "C", ())
    return {one.name: one for one in without_derivative(groups, MACHINE)}


def test_these_effects_give_the_machine_new_coordinates():
    found = structural()
    assert set(found) == {"second_clearance", "guide_clearance", "rod_flexibility", "flexible_base"}


def test_a_ladder_finds_where_a_power_law_crosses_from_either_side_and_asks_as_little_as_it_can():
    (gap,) = structural("second_clearance").values()
    asked = []

    def left(size):
        asked.append(size)
        return {"one": LEFT * (size / 1.7e-5) ** 2, "two": LEFT * (size / 6e-5) ** 3}

    sizes, near = Ladder(gap, left).smallest(0)
    assert sizes == {"one": pytest.approx(1.7e-5), "two": pytest.approx(6e-5)}
    first = len(asked)
    asked.clear()
    assert Ladder(gap, left).smallest(near)[0] == sizes
    assert len(asked) == len(set(asked)) < first
    asked.clear()
    assert Ladder(gap, left).smallest(99)[0] == sizes  # from where nothing shows it
    assert len(asked) == len(set(asked))


def test_frequencies_weaken_upwards_and_stay_within_their_bounds():
    (rod,) = structural("rod_flexibility").values()
    ladder = Ladder(rod, lambda frequency: {"one": LEFT * (3e3 / frequency) ** 4})
    assert (np.diff(ladder.sizes) > 0.0).all()
    assert 50.0 < ladder.sizes[0] < ladder.sizes[-1] < 2e4
    assert ladder.smallest(0)[0] == {"one": pytest.approx(3e3)}


def test_what_always_shows_is_at_most_the_weakest_rung_and_what_never_shows_has_no_size():
    (gap,) = structural("second_clearance").values()
    ladder = Ladder(gap, lambda _: {"always": 1.0, "never": 0.0, "lost": np.inf})
    assert ladder.smallest(3)[0] == {"always": ladder.sizes[-1], "never": None, "lost": ladder.sizes[-1]}


def test_what_shows_again_beyond_what_does_not_does_not_count():
    (gap,) = structural("second_clearance").values()
    ladder = Ladder(gap, lambda _: {})
    each = [1.0, 1.0, 0.05, 1.0] + [0.01] * 9
    ladder.left = {k: {"one": left} for k, left in enumerate(each)}
    size = ladder.smallest(0)[0]["one"]
    assert ladder.sizes[2] < size < ladder.sizes[1]


def test_the_highest_limit_is_that_of_the_sensor_which_shows_least():
    effect = {one.name: one for one in limits_of_sensors(load_effects("all", []))}
    assert set(effect) == {"sensor_resonance", "sensor_saturation"}
    signals = np.outer(np.sin(np.linspace(0.0, 6.0, 500)), np.arange(1.0, 11.0) * 10.0)
    limits = rungs(effect["sensor_saturation"], signals)
    peaks = np.abs(signals).max(axis=0)
    assert [fault.values[3] / peaks[3] for fault in limits] == sorted(f.values[3] / peaks[3] for f in limits)
    changed = limits[0].change(signals, ACCELERATIONS[3], 1e4)
    assert np.abs(signals + changed)[:, 3].max() == pytest.approx(limits[0].values[3])
    assert not np.delete(changed, 3, axis=1).any()
    resonances = rungs(effect["sensor_resonance"], signals)
    values = np.array([fault.values[0] for fault in resonances])
    errors = np.full((len(values), 10), np.inf)
    errors[:, 2] = (values / 3e3) ** 2 / STANDARD_ERRORS  # a change falls with the square of the frequency
    errors[:, 7] = (values / 9e3) ** 2 / STANDARD_ERRORS
    assert highest(resonances, errors) == pytest.approx(3e3)
    assert highest(resonances, np.full((len(values), 10), np.inf)) is None
    assert highest(resonances, np.full((len(values), 10), 1e-3)) == values[-1]


@pytest.mark.parametrize("name", ["second_clearance", "rod_flexibility"])
def test_noisy_recordings_show_more_than_the_stored_size_and_not_less(name):
    stored = nominal_map(SETTING, CLEARANCE, RPM, [], [])["effects"]
    kept = next(one for one in stored if one["name"] == name)
    size = kept["size"]["rod"][CLEARANCES.index(CLEARANCE)][SPEEDS.index(RPM)]
    (effect,) = structural(name).values()
    model, start = SETTING.model(), np.array([[CLEARANCE, RPM]])
    machine = model.machine(start[0])
    sigma = follower_on_path(machine).measured.sigma
    stronger = 0.5 if kept["seen"] == "below" else 2.0
    misfit = {}
    for factor in (stronger, 1.0 / stronger):
        values = effect.start.copy()
        values[0] = factor * size
        run = follower_on_path(effect.apply(machine, values))
        noise = sigma * np.random.default_rng(0).normal(size=run.measured.values.shape)
        use = [ACCELERATIONS.index(channel) for channel in ROD.channels]
        measured = replace(
            run.measured, values=(run.measured.values + noise)[..., use], channels=ROD.channels,
            signals=tuple(use), sigma=sigma[use],
        )  # fmt: skip
        follower = Follower(measured, run.integrator, run.input_sigma.copy())
        follower.path = run.path.copy()
        misfit[factor] = settle([follower], model, start, 6, 1e-3, 1).level
    assert misfit[stronger] > CALM > misfit[1.0 / stronger]


def test_what_is_left_counts_in_variances_of_noise_and_no_run_leaves_infinitely_much():
    (gap,) = structural("second_clearance").values()
    wide = left_by_sensor_set(SETTING, gap, CLEARANCE, RPM, [ROD, SLIDER], 1e-4)
    assert wide["rod"] > 10.0 * LEFT
    assert wide["slider"] < wide["rod"]  # one channel binds the path less than four
    with_nan = replace(gap, apply=lambda machine, _: replace(machine, joint_b=Joint(5e-2)))
    assert left_by_sensor_set(SETTING, with_nan, CLEARANCE, RPM, [ROD], 1e-4) == {"rod": np.inf}
