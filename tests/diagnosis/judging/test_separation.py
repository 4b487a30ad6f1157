"""Which recording tells explanations apart: what is foreseen is what a noisy recording then shows."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.judging.detectability import follower_on_path
from clearance.diagnosis.judging.separation import Experiment, _left, _recorded, advised, experiments
from clearance.diagnosis.shooting.settle import settle
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import ACCELERATIONS

RPM, SAMPLES = 700.0, 40000
MACHINE = SliderCrank(joint_c=Joint(1e-4))
SETTING = Setting(MACHINE, "C")
ROD = ACCELERATIONS[4:8]


def attempt(*names, values=()):
    groups = gather(load_effects(list(names), []), MACHINE, "C", ())
    held = [h for each in groups.values() for h in each if len(h.unknowns) == 1][: len(names)]
    model = SETTING.model(held)
    return SimpleNamespace(
        hypotheses=tuple(held), model=model, fit=SimpleNamespace(values=np.array([[1e-4, *values, RPM]]))
    )


LITTLE, MORE = (attempt("guide_friction", values=(force,)) for force in (0.02, 0.1))  # N
NOMINAL = attempt()


@pytest.fixture(scope="module")
def rod():
    """A recording of the rod's four sensors with one per cent of noise."""
    whole = follower_on_path(MACHINE).measured
    kept = [ACCELERATIONS.index(c) for c in ROD]
    return replace(
        whole, values=whole.values[..., kept], recorded=whole.recorded[:, kept], channels=ROD,
        signals=tuple(kept), sigma=whole.sigma[kept], limits=whole.limits[kept],
    )  # fmt: skip


def test_a_sensor_that_feels_the_difference_is_worth_fewer_recordings(rod):
    found = experiments(SimpleNamespace(samples=SAMPLES), [LITTLE, NOMINAL], [rod])
    needed = {(one.channel, round(one.speed_rpm)): one.recordings for one in found}
    assert list(needed.values()) == sorted(needed.values())
    same = needed.pop((None, 700))
    assert set(needed) == {(None, 525), (None, 931), *((c, 700) for c in ACCELERATIONS if c not in ROD)}
    assert 10 < needed["crank_b_transverse", 700] < 0.85 * same
    assert needed["slider_horizontal", 700] < same
    assert same <= needed["crank_a_axial", 700] < 1.2 * same  # it rests, and is no more than further samples


@pytest.mark.parametrize("left", [np.inf, 1e-300])
def test_what_is_lost_at_once_takes_one_recording_and_what_is_the_same_countless_ones(rod, monkeypatch, left):
    monkeypatch.setattr("clearance.diagnosis.judging.separation._left", lambda *_: (left, 20_000))
    explanation = SimpleNamespace(samples=SAMPLES)
    found = experiments(explanation, [LITTLE, NOMINAL], [rod])
    assert {one.recordings for one in found} == {1 if left == np.inf else 10**6}
    assert experiments(explanation, [LITTLE, NOMINAL], [rod], lambda: True) == []


def test_what_is_foreseen_is_what_a_noisy_recording_shows_on_average(rod):
    deaf = [c for c in ACCELERATIONS if c not in ROD]
    run = _recorded(MORE, RPM, rod, deaf)
    (foreseen, samples), seen, generator = _left(NOMINAL, RPM, run), [], np.random.default_rng(1)
    for _ in range(4):
        noise = run.measured.sigma * generator.normal(size=run.measured.values.shape)
        values = run.measured.values + np.where(run.measured.sigma < 1e3, noise, 0.0)
        prices = []
        for one in (MORE, NOMINAL):
            follower = run.part(0, run.segments)
            recorded = values.reshape(-1, values.shape[2])
            follower.measured = replace(follower.measured, values=values, recorded=recorded)
            found = settle([follower], one.model, one.fit.values, 6, 1e-4, 1)
            assert samples == sum(one.samples for one in found.passes)
            prices.append(found.level * samples)
        seen.append(prices[1] - prices[0])
    # without noise the tenth of the segments that is not counted holds more of the difference than with it
    assert 0.7 < foreseen / np.mean(seen) < 1.1


def test_what_is_advised_is_said_in_plain_words():
    found = [Experiment(1, 700.0, "slider_vertical"), Experiment(4, 525.0, other_speed=True)]
    assert (
        advised(found)
        == "One further recording with slider_vertical too would tell these explanations apart."
    )
    assert advised(found[1:]).startswith("4 further recordings at 525 rpm would")
    assert advised([Experiment(12, 700.0)]).startswith("12 further recordings like these would")
    far = [Experiment(101, 700.0)]
    assert advised(far).startswith("No other speed and no further accelerometer")
    assert advised([]).endswith("could not be reckoned.")
    for none in ([], far):
        assert advised(none, tried=False).startswith("There was no time to reckon")
