"""What an ideal machine does at angles of its crank."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import arguments_of
from clearance.diagnosis.kinematics.rigid_motion import tilt
from tests.diagnosis.kinematics.test_reconstruction import machine
from tests.simulation.scipy_model import ideal_kinematics


@pytest.mark.parametrize("offset", [0.0, 4e-3])
def test_the_rod_turns_as_in_closed_form(offset):
    one, angle = replace(machine("C", 1e-4), guide_offset=offset), np.linspace(-3.0, 9.0, 50)
    exact = ideal_kinematics(angle, 1.0, 0.0, offset=offset)["rod_angle"]
    np.testing.assert_allclose(tilt(one.parameters(), angle), exact, atol=1e-12)


def test_how_the_rod_is_turned_is_the_place_of_the_rod_alone():
    assert "rod_angle" in arguments_of("rod")
    assert "rod_angle" not in arguments_of("slider")
    assert "slider_velocity" in arguments_of("slider")
