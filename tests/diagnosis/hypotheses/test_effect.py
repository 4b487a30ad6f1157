"""Every effect that the diagnosis knows: its file, its machine, where it vanishes, what it says."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml

from clearance.configuration import CONFIGURATION
from clearance.diagnosis.hypotheses.effect_files import load_effects, read_effect
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather, of_effect
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.errors import InputError
from clearance.mechanism.drive import DirectCurrentMotor, SpeedControl
from clearance.mechanism.guide import StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.integrator import Integrator
from clearance.simulation.trajectory import simulate_trajectory

NOMINAL = SliderCrank(joint_c=Joint(2e-4), drive=SpeedControl(700.0, ramp=0.02))
FILES = sorted((CONFIGURATION / "effect").glob("*.yaml"))
PHYSICS = load_effects("physics")
VARIANTS = [variant for effect in PHYSICS for variant in effect.variants()]
NAMES = {
    "physics": "joint_friction joint_lubrication second_clearance worn_bearing restitution contact_stiffness "
    "guide_friction guide_clearance slider_offset rod_inertia rod_flexibility torque_ripple soft_drive "
    "slider_spring process_load gravity flexible_base",
    "instrument": "sensor_gain sensor_bias sensor_misalignment sensor_delay sensor_resonance "
    "sensor_saturation timebase",
}
# their limit is a law of its own: no small number stands for a stiff frame or a guide without play
SINGULAR = ("guide_clearance", "rod_flexibility", "flexible_base", "soft_drive", "second_clearance")


def label(variant):
    return f"{variant.name}-{'-'.join(variant.parameters)}"


def start(variant):
    return {parameter.name: parameter.start for parameter in variant.free}


@cache
def nominal_signals():
    return simulate_trajectory(NOMINAL, Integrator(), 0.03).signals


@pytest.mark.parametrize("kind", NAMES)
def test_the_diagnosis_knows_the_effects_that_it_must(kind):
    assert sorted(effect.name for effect in load_effects(kind)) == sorted(NAMES[kind].split())


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_file_says_what_a_report_needs(path):
    effect = read_effect(path)
    assert len(effect.reference) > 10
    assert len(effect.validity) > 10
    assert effect.body
    assert effect.direction
    assert any(not parameter.shape for parameter in effect.free)
    off = effect.off(NOMINAL, "C")
    for variant in effect.variants():
        sizes = [parameter for parameter in variant.free if not parameter.shape]
        assert sizes
        for parameter in sizes:
            assert parameter.start != off[parameter.name]
        text = variant.describe(start(variant), "C")
        assert text.endswith(".")
        assert "{" not in text
        assert "joint_" not in text


@pytest.mark.parametrize("variant", VARIANTS, ids=label)
@pytest.mark.parametrize("joint", ["B", "C"])
def test_a_machine_with_an_effect_is_another_one_and_runs(variant, joint):
    nominal = NOMINAL if joint == "C" else replace(NOMINAL, joint_b=Joint(2e-4), joint_c=Joint())
    machine = variant.machine(nominal, joint, start(variant))
    same_codes = np.array_equal(machine.codes(), nominal.codes())
    assert not (same_codes and np.array_equal(machine.parameters(), nominal.parameters()))
    assert not nominal.codes()[machine.codes() != nominal.codes()].any()
    if joint == "C":
        run = simulate_trajectory(machine, Integrator(), 0.03)
        assert run.finite
        assert np.abs(run.signals - nominal_signals()).max() > 0.0


@pytest.mark.parametrize("variant", VARIANTS, ids=label)
def test_an_effect_that_is_off_leaves_the_machine_as_it_is(variant):
    off = variant.off(NOMINAL, "C")
    assert variant.machine(NOMINAL, "C", off) == NOMINAL
    if variant.name in SINGULAR:
        return
    # nearly off: nearly the same signals, from the same laws that the start value uses
    near = {
        p.name: p.start if p.shape else off[p.name] + 1e-9 * (p.start - off[p.name]) for p in variant.free
    }
    machine = variant.machine(NOMINAL, "C", near)
    assert machine != NOMINAL
    signals = simulate_trajectory(machine, Integrator(), 0.03).signals
    # a thousand times what a linear response gives: contact amplifies
    scale = np.abs(nominal_signals()).max(axis=0) + 1.0
    assert (np.abs(signals - nominal_signals()) < 1e-5 * scale).all()


@pytest.mark.parametrize("variant", VARIANTS, ids=label)
def test_every_start_of_a_fit_is_a_machine_within_the_bounds(variant):
    starts = list(variant.starts(NOMINAL, "C"))
    assert starts
    for values in starts:
        for name, value in values.items():
            low, high = variant.parameter(name).bounds
            assert low <= value <= high


def test_effects_act_where_they_say():
    (friction,) = load_effects("joint_friction")
    machine = friction.machine(NOMINAL, "C", {"friction_coefficient": 0.2})
    assert machine.joint_c.friction.friction_coefficient == 0.2
    assert machine.joint_b == NOMINAL.joint_b
    assert (friction.place("B"), friction.place("C")) == ("joint_b", "joint_c")
    (second,) = load_effects("second_clearance")
    assert second.machine(NOMINAL, "C", {"clearance": 1e-4}).joint_b.clearance == 1e-4
    assert second.place("C") == "joint_b"
    (inertia,) = load_effects("rod_inertia")
    machine = inertia.machine(NOMINAL, "C", {"mass_ratio": 1.5, "com_shift": 0.012})
    assert machine.rod.mass == pytest.approx(0.315)
    assert machine.rod.inertia == NOMINAL.rod.inertia
    assert machine.rod.center_of_mass == pytest.approx(0.6)
    (drive,) = load_effects("soft_drive")
    motor = drive.variants()[1].machine(NOMINAL, "C", {"stall_torque": 3.0})
    assert isinstance(motor.drive, DirectCurrentMotor)
    assert motor.drive.stall_torque == 3.0
    (process,) = load_effects("process_load")
    machine = process.machine(NOMINAL, "C", {"force": 5.0, "start": 0.15, "end": 0.16})
    assert (machine.process.start, machine.process.end) == (0.15, 0.16)


def test_effects_compose_and_a_law_that_is_there_keeps_its_other_numbers():
    greased = replace(NOMINAL, guide_friction=StribeckGuide(viscous_damping=0.7))
    friction, gravity = load_effects(["guide_friction", "gravity"])
    machine = friction.machine(greased, "C", {"coulomb_force": 5.0})
    machine = gravity.machine(machine, "C", {"gravity_y": -9.0})
    assert machine.guide_friction == StribeckGuide(coulomb_force=5.0, viscous_damping=0.7)
    assert machine.gravity == (0.0, -9.0)


def test_a_law_that_is_there_is_off_at_its_own_number():
    """Of friction that the machine has there may be more or less: nothing jumps at none."""
    greased = replace(NOMINAL, guide_friction=StribeckGuide(coulomb_force=2.0))
    (friction,) = load_effects(["guide_friction"])
    coulomb = friction.variants()[0]
    assert coulomb.off(greased, "C") == {"coulomb_force": 2.0}
    assert coulomb.machine(greased, "C", {"coulomb_force": 2.0}) is greased
    less = coulomb.machine(greased, "C", {"coulomb_force": 0.0})
    assert less.guide_friction.coulomb_force == 0.0
    assert list(coulomb.starts(greased, "C")) == [{"coulomb_force": 5.0}]
    assert coulomb.off(NOMINAL, "C") == {"coulomb_force": 0.0}


def test_an_instruments_effect_leaves_the_machine_and_changes_the_instruments():
    gain, clock = load_effects(["sensor_gain", "timebase"])
    assert gain.machine(NOMINAL, "C", {"gain": 1.1}) == NOMINAL
    with pytest.raises(InputError, match="which channel"):
        gain.instrument(Instrument(), {"gain": 1.1})
    one = gain.variants(["rod_c_axial", "crank_angle"])
    assert [variant.channel for variant in one] == ["rod_c_axial"]
    changed = one[0].instrument(Instrument(), {"gain": 1.1})
    assert changed == Instrument(gain={"rod_c_axial": 1.1})
    assert clock.instrument(changed, {"rate_error": 0.01}).timebase == 0.01
    assert "rod_c_axial" in one[0].describe({"gain": "1.1 (1.0 to 1.2)"}, "C")


def test_hypotheses_are_chosen_by_name_and_kind():
    assert len(load_effects()) == len(FILES)
    assert {effect.kind for effect in load_effects("instrument")} == {"instrument"}
    chosen = load_effects(["gravity", "sensor_gain"], without=["gravity"])
    assert [effect.name for effect in chosen] == ["sensor_gain"]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"names": "guide_frction"},
            r"hypotheses: 'guide_frction' .* did you mean 'guide_friction'\?.*gravity",
        ),
        ({"without": ["fog"]}, r"without: 'fog' is not an effect.*timebase"),
    ],
)
def test_an_effect_that_does_not_exist_is_refused(settings, message):
    with pytest.raises(InputError, match=message):
        load_effects(**settings)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "magic"}, "kind = 'magic' is not one of"),
        ({"name": "other"}, "name = 'other' must be the file's"),
        ({"sentense": "x"}, r"unknown key 'sentense'; did you mean 'sentence'\?"),
        ({"reference": None}, "the key 'reference' is missing"),
        ({"free": {}}, "free names no parameter"),
        ({"variants": [["speed"]]}, "variants: effect broken has no parameter 'speed'; it has size"),
        ({"variants": ["size"]}, "variants: 'size' names no parameters"),
        ({"size": {"bounds": [1.0, 0.0]}}, r"free\.size: bounds = \[1\.0, 0\.0\] do not rise"),
        ({"size": {"start": "much"}}, r"free\.size: could not convert"),
        ({"size": {"scale": "log"}}, r"free\.size: .*reach 0 on a log scale"),
        ({"size": {"start": 7.0}}, r"free\.size: start = 7\.0 .* must lie within"),
        ({"size": {"pth": "x"}}, r"free\.size: unknown key 'pth'; did you mean 'path'"),
    ],
)
def test_a_file_that_describes_no_effect_is_refused(tmp_path, change, message):
    size = {"path": "process.force", "unit": "N", "bounds": [0.0, 1.0], "off": 0.0, "start": 0.5}
    size |= change.pop("size", {})
    content = {
        "name": "broken",
        "kind": "physics",
        "body": "slider",
        "direction": "x",
        "reference": "none",
        "validity": "none",
        "sentence": "{parameters}",
        "free": {"size": size},
    } | change
    path = tmp_path / "broken.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in content.items() if value is not None}))
    with pytest.raises(InputError, match=message):
        read_effect(path)


def test_what_an_effect_cannot_do_is_said():
    (gravity, friction) = load_effects(["gravity", "guide_friction"])
    with pytest.raises(InputError, match=r"gravity has no parameter 'g'; it has gravity_x, gravity_y"):
        gravity.machine(NOMINAL, "C", {"g": 1.0})
    with pytest.raises(InputError, match="joint = 'A' is not one of B, C"):
        gravity.machine(NOMINAL, "A", {"gravity_x": 1.0})
    with pytest.raises(InputError, match="coulomb_force = -1"):
        friction.machine(NOMINAL, "C", {"coulomb_force": -1.0})
    (drive,) = load_effects("soft_drive")
    with pytest.raises(InputError, match=r"mechanism\.drive\.proportional: DirectCurrentMotor has no"):
        drive.machine(replace(NOMINAL, drive=DirectCurrentMotor()), "C", {"proportional": 1.0})


def test_the_no_load_speed_of_a_motor_is_each_recordings_own():
    groups = gather(load_effects("soft_drive"), NOMINAL, "C", ())
    model = Setting(NOMINAL, "C").model([groups["soft_drive(stall_torque)"][0]])
    assert model.machine(np.array([1e-4, 3.0, 650.0])).drive == DirectCurrentMotor(3.0, 650.0)


def test_a_phase_of_zero_can_be_fitted_and_a_count_cannot():
    ripple = next(v for v in VARIANTS if v.name == "torque_ripple")
    trial = next(h for h in of_effect(ripple, NOMINAL, "C") if h.start[2] == 0.0)
    amplitude, order, phase = trial.unknowns
    assert phase.step > 1e-6  # a smaller one drowns in rounding
    assert order.low == order.high == trial.start[1]
    assert amplitude.low < amplitude.high


def test_lobes_larger_than_a_gap_give_the_machine_no_coordinates():
    worn = of_effect(load_effects("worn_bearing")[0], NOMINAL, "C")[0]
    narrow = replace(NOMINAL, joint_c=replace(NOMINAL.joint_c, clearance=0.5 * float(worn.start[0])))
    with pytest.raises(InputError, match="closes the bore"):
        worn.apply(narrow, worn.start)
    assert not worn.structural(narrow)
    loose = of_effect(load_effects("guide_clearance")[0], NOMINAL, "C")[0]
    assert loose.structural(narrow)


def test_one_lobe_is_taken_no_derivative_by():
    worn = [h for h in of_effect(load_effects("worn_bearing")[0], NOMINAL, "C") if h.start[1] == 1.0]
    model = Setting(NOMINAL, "C").model(worn[:1])  # fewer than one are none that a bearing can have
    machines, _ = model.columns(np.array([1e-4, *worn[0].start, 700.0]))
    assert [machine is None for machine in machines] == [False, False, True, False, False]


@pytest.mark.parametrize(
    ("channels", "turned"),
    [
        (("crank_b_axial", "rod_c_axial"), []),  # the other axis was not recorded: no angle can be taken out
        (("crank_b_axial", "crank_b_transverse"), ["crank_b_axial", "crank_b_transverse"]),
        (("slider_horizontal",), ["slider_horizontal"]),  # the other axis stands still
    ],
)
def test_only_a_fault_that_can_be_undone_is_a_hypothesis(channels, turned):
    groups = gather(load_effects(["sensor_misalignment", "sensor_gain"]), NOMINAL, "C", channels)
    held = [group[0] for group in groups.values()]
    assert [h.channel for h in held if h.name == "sensor_misalignment"] == turned
    assert [h.channel for h in held if h.name == "sensor_gain"] == list(channels)


def test_all_may_stand_in_a_list_and_what_is_no_mapping_is_refused(tmp_path):
    assert load_effects(["all"]) == load_effects("all")
    path = tmp_path / "gravity.yaml"
    for key, value, called in (("free", ["x"], "mapping"), ("variants", 3, "list")):
        content = yaml.safe_load((CONFIGURATION / "effect/gravity.yaml").read_text()) | {key: value}
        path.write_text(yaml.safe_dump(content))
        with pytest.raises(InputError, match=f"{key} = .* is no {called}"):
            read_effect(path)
