"""Numbers beside a clock at fault are given by true seconds, and so is the machine that is handed on."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.judging.true_seconds import by_true_seconds, machine_of, seconds_of
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.slider_crank import SliderCrank

PACE, CLEARANCE, RPM = 1.05, 3e-4, 700.0
SETTING = Setting(SliderCrank(drive=SpeedControl(RPM)), "C")
UNITS = {"": 0, "-": 0, "kg": 0, "m": 0, "deg": 0, "rad": 0, "s": 1, "m/s": -1, "m/s^2": -2, "Hz": -1,
         "N": -2, "N/m": -2, "N s/m": -1, "N m": -2, "N m s/rad": -1, "N m/rad": -2}  # fmt: skip


def attempt(*names_and_values):
    """An attempt with hypotheses and their values, as a clock sees them that lasts ``PACE`` true seconds."""
    groups = gather(load_effects("all"), SETTING.machine, "C", ("rod_c_axial",))
    chosen = [(next(g[0] for g in groups.values() if g[0].label == n), v) for n, v in names_and_values]
    held = [hypothesis for hypothesis, _ in chosen]
    values = np.concatenate([[CLEARANCE], *[own for _, own in chosen], [PACE * RPM]])
    return SimpleNamespace(
        hypotheses=tuple(held), model=SETTING.model(held), fit=SimpleNamespace(values=values[None])
    )


def test_every_unit_of_an_effect_tells_its_power_of_the_second():
    seen = {(p.unit, p.seconds) for effect in load_effects("all") for p in effect.free}
    assert seen <= set(UNITS.items())
    assert {"N s/m", "N m/rad", "m/s^2", "Hz"} <= {unit for unit, _ in seen}


@pytest.mark.parametrize("first", [True, False])
def test_forces_and_gains_beside_a_clock_at_fault_are_those_of_the_machine(first):
    clock = ("timebase(rate_error)", [PACE - 1.0])
    drive = ("soft_drive(proportional, integral)", [3.0 * PACE, 90.0 * PACE**2])
    found = attempt(*([clock, drive] if first else [drive, clock]))
    assert by_true_seconds(found, found.fit.values[0, -1]) == pytest.approx(RPM)
    machine = machine_of(found, SETTING, 3.1e-4)
    assert (machine.drive.proportional, machine.drive.integral) == pytest.approx((3.0, 90.0))
    assert machine.drive.speed_rpm == pytest.approx(RPM)
    assert machine.joint_c == replace(SETTING.machine.joint_c, clearance=3.1e-4)  # as stiff as it was
    seen = found.model.machine(found.fit.values[0])
    assert (seen.drive.proportional, seen.drive.integral) == pytest.approx((3.0 * PACE, 90.0 * PACE**2))
    assert seen.joint_c.contact.stiffness_scale == pytest.approx(PACE**2)
    assert seconds_of(found)[0] == 1.0


def test_a_right_clock_changes_nothing():
    found = attempt(("guide_friction(coulomb_force)", [5.0]))
    np.testing.assert_allclose(seconds_of(found), 1.0)
    assert machine_of(found, SETTING, CLEARANCE) == found.model.machine(found.fit.values[0])
