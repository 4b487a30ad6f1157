"""What the motion alone tells of dimensions and sensors, whatever force is missing."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.kinematics.agreement import aligned, profile
from clearance.diagnosis.searching.geometry import (
    Shown,
    measure_rails,
    suggest_channels,
    suggest_dimensions,
    suggest_guide,
)
from clearance.diagnosis.searching.rattling import between_rails
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.sensing.demonstration import record
from clearance.diagnosis.sensing.instrument import stretch
from clearance.diagnosis.sensing.measured import Measured, chain_of
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.guide import LooseGuide, StribeckGuide
from clearance.mechanism.slider_crank import SliderCrank

SETTING = Setting(SliderCrank(), "C")
NOMINAL = replace(SETTING.with_clearance(2e-4), drive=SpeedControl(700.0, ramp=0.1))
EFFECTS = [
    "worn_bearing",
    "slider_offset",
    "second_clearance",
    "guide_clearance",
    "flexible_base",
    "sensor_bias",
    "sensor_gain",
    "timebase",
]


def traced(machine, damage=lambda channels, values: values):
    """A search after its first step, for a recording of a machine, with values damaged by its sensors."""
    recording = record(machine, 4)
    recording = replace(recording, values=damage(recording.channels, recording.values.copy()))
    measured = Measured.of(recording, chain_of(recording, "one"), "one").part(0, 160)
    groups = gather(load_effects(EFFECTS), SETTING.with_clearance(3e-4), "C", measured.channels)
    alignment = aligned(measured, SETTING.with_clearance(3e-4), (50.0, 150.0))
    search = Search([measured], [alignment], SETTING, groups, 1, lambda _: None)
    search.trace()
    return search


@pytest.mark.slow
def test_a_guide_line_that_lies_elsewhere():
    (found, *_) = suggest_dimensions(traced(replace(NOMINAL, guide_offset=-3e-3)), {})
    assert found.hypothesis.name == "slider_offset"
    assert found.value == pytest.approx(-3e-3, rel=0.1)
    assert found.clearance == pytest.approx(2e-4, rel=0.15)


@pytest.mark.slow
def test_play_in_the_other_joint():
    loose = replace(NOMINAL, joint_b=replace(NOMINAL.joint_b, clearance=1e-4))
    (found, *_) = suggest_dimensions(traced(loose), {})
    assert found.hypothesis.name == "second_clearance"
    assert found.value == pytest.approx(1e-4, rel=0.2)
    assert found.share < 0.5


@pytest.mark.slow
def test_an_offset_of_one_sensor():
    def damage(channels, values):
        values[:, channels.index("rod_c_transverse")] += 60.0
        return values

    search = traced(NOMINAL, damage)
    channels = suggest_channels(search)
    assert next(iter(channels)) == "rod_c_transverse"
    (found, *_) = suggest_dimensions(search, channels)
    assert (found.hypothesis.name, found.hypothesis.channel) == ("sensor_bias", "rod_c_transverse")
    assert found.value == pytest.approx(60.0, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("clearance", [2e-4, 6e-4])
def test_a_clock_that_runs_slow_and_the_clearance_that_goes_with_it(clearance):
    """Beside a wrong clock the motion shows a clearance five times too large."""
    machine = replace(NOMINAL, joint_c=replace(NOMINAL.joint_c, clearance=clearance))
    search = traced(machine, lambda channels, values: stretch(values, 0.0477))
    (found, *_) = suggest_dimensions(search, {})
    assert found.hypothesis.name == "timebase"
    assert found.value == pytest.approx(0.0477, rel=0.03)
    assert found.clearance == pytest.approx(clearance, rel=0.25)


@pytest.mark.slow
def test_a_missing_force_points_at_no_dimension_and_no_sensor():
    friction = StribeckGuide(
        coulomb_force=6.0, viscous_damping=0.0, stribeck_force=0.0, friction_coefficient=0.0
    )
    search = traced(replace(NOMINAL, guide_friction=friction))
    assert suggest_channels(search) == {}
    assert suggest_dimensions(search, {}) == []
    assert suggest_guide(search, Shown.nothing(search)) is None
    assert np.isfinite(search.profile.misfit).all()


@pytest.mark.slow
def test_a_slider_that_is_loose_in_its_guide():
    machine = replace(NOMINAL, joint_c=replace(NOMINAL.joint_c, clearance=1e-4), guide=LooseGuide(gap=7e-5))
    search = traced(machine)
    found = suggest_guide(search, Shown.nothing(search))
    assert search.profile.best > 1.3e-4  # what the slider does is taken for the journal's play
    assert found.hypothesis.name == "guide_clearance"
    assert found.value == pytest.approx(7e-5, rel=0.1)
    assert found.clearance == pytest.approx(1e-4, rel=0.2)
    assert found.share < 0.5


@pytest.mark.slow
def test_a_frame_that_gives_way_has_no_rails():
    search = traced(replace(NOMINAL, frame=FlexibleFrame(frequency=40.0)))
    assert suggest_guide(search, Shown.nothing(search)) is None


@pytest.mark.slow
def test_rails_on_a_frame_that_gives_way():
    frame = FlexibleFrame(frequency=40.0)
    joint = replace(NOMINAL.joint_c, clearance=1e-4)
    search = traced(replace(NOMINAL, joint_c=joint, guide=LooseGuide(gap=7e-5), frame=frame))
    giving = next(g[0] for g in search.groups.values() if g[0].name == "flexible_base")
    sizes = np.array([{"frequency": 40.0, "damping_ratio": frame.damping_ratio, "mass": frame.mass}[u.name]
                      for u in giving.unknowns])  # fmt: skip
    beside = profile(
        search.recordings, search.alignments,
        lambda c: giving.apply(SETTING.with_clearance(c), sizes), 1,
    )  # fmt: skip
    shown = Shown((giving,), sizes, 0.1 * sizes, beside)
    found = suggest_guide(search, shown)
    assert found.value == pytest.approx(7e-5, rel=0.15)
    assert found.clearance == pytest.approx(1e-4, rel=0.2)
    rails = measure_rails(search, found, shown)
    assert [h.name for h in rails.beside] == ["flexible_base"]
    assert rails.deviations[2:] == pytest.approx(0.1 * sizes)
    both = between_rails(search, rails)
    assert [h.name for h in both.hypotheses] == ["guide_clearance", "flexible_base"]
    assert both.fit.values[0, :2] == pytest.approx([rails.clearance, rails.gap])
    assert both.reach.shape == (both.model.shared, 2)
