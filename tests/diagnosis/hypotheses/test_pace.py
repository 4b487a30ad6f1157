"""What a machine looks like by a clock that runs fast or slow."""

from dataclasses import replace

import pytest

from clearance.diagnosis.hypotheses.hypothesis import at_pace
from clearance.mechanism.drive import DirectCurrentMotor, SpeedControl
from clearance.mechanism.slider_crank import SliderCrank

LASTS = 1.05  # true seconds in one of the clock's


def test_torques_count_the_square_of_the_unit_of_time_and_dampings_its_first_power():
    motor = at_pace(replace(SliderCrank(), drive=DirectCurrentMotor(2.0, 800.0)), LASTS - 1.0).drive
    assert motor.stall_torque == pytest.approx(2.0 * LASTS**2)
    assert motor.no_load_rpm == 800.0
    control = SpeedControl(proportional=5.0, integral=20.0)
    seen = at_pace(replace(SliderCrank(), drive=control), LASTS - 1.0)
    assert seen.drive.proportional == pytest.approx(5.0 * LASTS)
    assert seen.drive.integral == pytest.approx(20.0 * LASTS**2)
    assert seen.joint_c.contact.stiffness_scale == pytest.approx(LASTS**2)
    assert at_pace(seen, 0.0) is seen
