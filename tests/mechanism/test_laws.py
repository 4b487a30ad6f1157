"""Each law against its textbook properties."""

from dataclasses import fields, is_dataclass, replace
from inspect import getmembers, isclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clearance.errors import InputError
from clearance.mechanism import applied_force, bearing, drive, film, frame, friction, guide, link, load
from clearance.mechanism.contact import Flores, HuntCrossley, LankaraniNikravesh, normal_force
from clearance.mechanism.joint import Joint
from clearance.mechanism.parameters import JOINT_STRIDE, Law, Parameter
from clearance.mechanism.slider_crank import Link, SliderCrank

FAMILY_FILES = (applied_force, bearing, drive, film, frame, friction, guide, link, load)
LAWS = [
    member
    for file in FAMILY_FILES
    for _, member in getmembers(file, isclass)
    if issubclass(member, Law) and is_dataclass(member) and member.__module__ == file.__name__
]
CONTACTS = [LankaraniNikravesh, HuntCrossley, Flores]


@pytest.mark.parametrize("law", CONTACTS)
@given(depth=st.floats(1e-9, 1e-4), more=st.floats(1e-9, 1e-4), speed=st.floats(1e-3, 5.0))
@settings(deadline=None, max_examples=50)
def test_contact_is_zero_apart_grows_with_depth_and_dissipates(law, depth, more, speed):
    numbers = (law().stiffness(0.01, 1e-4), law().hysteresis)
    assert normal_force(-depth, speed, speed, *numbers) == 0.0
    shallow, deep = (normal_force(d, 0.0, speed, *numbers) for d in (depth, depth + more))
    assert deep > shallow > 0.0
    approaching, leaving = (normal_force(depth, v, speed, *numbers) for v in (speed, -speed))
    assert approaching > leaving >= 0.0  # work put in on the way in is not given back in full
    static = normal_force(depth, 0.0, speed, *numbers)
    assert approaching == pytest.approx((1.0 + numbers[1]) * static)
    assert leaving == pytest.approx(max(1.0 - numbers[1], 0.0) * static)


@pytest.mark.parametrize("velocity", [-2.0, -0.3, 1e-4, 0.3, 2.0])
def test_friction_of_the_guide_is_coulombs_stribecks_and_viscous(velocity):
    law = guide.StribeckGuide(5.0, 3.0, 2.0, 0.5, friction_coefficient=0.1)
    p = SliderCrank(guide_friction=law).parameters()
    dry = 5.0 + 2.0 * np.exp(-((velocity / 0.5) ** 2)) + 0.1 * 30.0
    slide = velocity / np.hypot(velocity, law.smoothing_speed)
    expected = -(dry * slide + 3.0 * velocity)
    assert guide.guide_friction(p, velocity, -30.0) == pytest.approx(expected, rel=1e-6)


def test_stiffness_is_the_published_value():
    # MECHANISM: about 1.5e11 N/m^1.5 at c = 0.1 mm
    assert LankaraniNikravesh().stiffness(0.01, 1e-4) == pytest.approx(1.47e11, rel=0.01)


def test_hysteresis_factors():
    assert LankaraniNikravesh(restitution=0.6).hysteresis == pytest.approx(0.48)
    assert HuntCrossley(restitution=0.6).hysteresis == pytest.approx(0.6)
    assert Flores(restitution=0.6).hysteresis == pytest.approx(1.6 * 0.4 / 0.6)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_rejects_what_is_not_a_number(law):
    for field in fields(law):
        for bad in ("abc", float("nan"), float("inf")):
            with pytest.raises(InputError, match=field.name):
                law(**{field.name: bad})


def test_each_family_has_one_null_member():
    families = {}
    for law in LAWS:
        families.setdefault(law.family, []).append(law)
    for family, members in families.items():
        null = [law for law in members if law.code == 0]
        assert len(null) == 1, family
        # a speed that is divided by where the other joint has friction
        assert set(null[0]().numbers()) <= {Parameter.JOINT_FRICTION_SPEED}
        assert len(fields(null[0])) == 0


@given(
    x=st.floats(-1e-3, 1e-3),
    y=st.floats(-1e-3, 1e-3),
    turn=st.floats(-3.0, 3.0),
    order=st.integers(1, bearing.MAXIMUM_ORDER),
    phase=st.floats(-3.0, 3.0),
)
@settings(deadline=None, max_examples=100)
def test_worn_surface_is_the_formula_of_a_wavy_circle(x, y, turn, order, phase):
    radius = np.hypot(x, y)
    if radius < 1e-5:
        return
    amplitude, clearance = 3e-5, 4e-4
    joint = Joint(clearance=clearance, bearing=bearing.Worn(amplitude, order, phase))
    p = SliderCrank(joint_b=joint).parameters()
    depth, nx, ny = bearing.worn_surface(p, 0, x, y, radius, np.sin(turn), np.cos(turn))
    phi = np.arctan2(y, x) - turn
    local = clearance + amplitude * np.cos(order * phi + phase)
    slope = -amplitude * order * np.sin(order * phi + phase) / radius
    stretch = np.sqrt(1 + slope**2)
    radial = np.array([x, y]) / radius
    around = np.array([-y, x]) / radius
    assert depth == pytest.approx((radius - local) / stretch, abs=1e-12)
    np.testing.assert_allclose([nx, ny], (radial - slope * around) / stretch, atol=1e-9)


def test_lobes_are_a_whole_number():
    assert bearing.Worn(order=2.0).numbers() == bearing.Worn(order=2).numbers()
    with pytest.raises(InputError, match=r"order = 2\.5 is not a whole number"):
        bearing.Worn(order=2.5)


def test_a_bore_is_not_closed_by_its_lobes():
    worn = Joint(3e-5, bearing=bearing.Worn(2e-5))
    assert not Joint(0.0, bearing=worn.bearing).loose  # an ideal joint has no bore
    for closed in (2e-5, 1e-5):
        with pytest.raises(InputError, match=r"bearing\.amplitude = 2e-05 m.*clearance.*'clearance'"):
            replace(worn, clearance=closed)


def test_a_linkage_that_cannot_turn_is_refused():
    with pytest.raises(InputError, match=r"rod\.length.*0\.05"):
        SliderCrank(rod=Link(0.21, 2.5e-4, 0.05))
    with pytest.raises(InputError, match="guide_offset"):
        SliderCrank(guide_offset=0.08)
    with pytest.raises(InputError, match="mass"):
        Link(-1.0, 1e-5, 0.05)


def test_a_clearance_out_of_range_names_its_key():
    for bad in (-1e-6, 5e-3):
        with pytest.raises(InputError, match=r"clearance.*0\.002"):
            Joint(clearance=bad)


def test_every_entry_of_the_parameter_vector_is_distinct():
    assert len({int(entry) for entry in Parameter}) == len(Parameter.__members__)


def test_joint_c_has_the_layout_of_joint_b():
    assert Parameter.SECOND_JOINT == Parameter.JOINT_WEAR_COSINE + JOINT_STRIDE
    assert JOINT_STRIDE == Parameter.JOINT_WEAR_COSINE - Parameter.JOINT_CLEARANCE + 1
    p = SliderCrank(joint_b=Joint(1e-4), joint_c=Joint(3e-4)).parameters()
    assert p[Parameter.JOINT_CLEARANCE] == 1e-4
    assert p[Parameter.JOINT_CLEARANCE + JOINT_STRIDE] == 3e-4
