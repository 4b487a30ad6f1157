import math
from pathlib import Path

import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf

from clearance.errors import InputError
from clearance.recording.channels import (
    ACCELERATIONS,
    AXIS_PAIRS,
    CHANNELS,
    OTHER_CHANNELS,
    TIME,
    UNITS,
    SensorSet,
    require_channel,
    si_factor,
    si_unit,
)

# Table 9 of the paper, by the numbers of Table 3.
TABLE_9 = {
    "rod": (5, 6, 7, 8),
    "all": (1, 2, 3, 4, 5, 6, 7, 8, 9, 10),
    "no_slider": (1, 2, 3, 4, 5, 6, 7, 8),
    "no_crank": (5, 6, 7, 8, 9, 10),
    "no_rod": (1, 2, 3, 4, 9, 10),
    "crank": (1, 2, 3, 4),
}
CONF = Path(__file__).parents[2] / "conf"


def test_the_accelerations_are_those_of_table_3_in_order():
    assert ACCELERATIONS == (
        "crank_a_transverse",
        "crank_a_axial",
        "crank_b_transverse",
        "crank_b_axial",
        "rod_b_transverse",
        "rod_b_axial",
        "rod_c_transverse",
        "rod_c_axial",
        "slider_vertical",
        "slider_horizontal",
    )
    assert [CHANNELS[name].identifier for name in ACCELERATIONS] == list(range(1, 11))


def test_every_channel_has_a_unit_and_a_body_and_time_is_none_of_them():
    assert tuple(CHANNELS) == ACCELERATIONS + OTHER_CHANNELS
    assert TIME not in CHANNELS
    for name, channel in CHANNELS.items():
        assert channel.name == name
        assert channel.unit in UNITS
        assert channel.body == name.split("_")[0] or (name, channel.body) == ("drive_torque", "crank")


def test_every_acceleration_is_in_one_axis_pair():
    assert sorted(name for pair in AXIS_PAIRS for name in pair) == sorted(ACCELERATIONS)


@pytest.mark.parametrize(
    ("unit", "channel", "factor"),
    [
        ("g", "rod_b_axial", 9.80665),
        ("m/s^2", "slider_vertical", 1.0),
        ("mm/s^2", "slider_vertical", 1e-3),
        ("deg", "crank_angle", math.pi / 180),
        ("rev", "crank_angle", 2 * math.pi),
        ("rpm", "crank_speed", math.pi / 30),
        ("deg/s", "crank_speed", math.pi / 180),
        ("N m", "drive_torque", 1.0),
        ("mm", "slider_position", 1e-3),
        ("mm/s", "slider_velocity", 1e-3),
        ("ms", TIME, 1e-3),
        (" us ", TIME, 1e-6),
    ],
)
def test_units_are_converted_to_si(unit, channel, factor):
    assert si_factor(unit, channel) == pytest.approx(factor, rel=1e-15)


def test_the_si_unit_of_every_channel_has_factor_one():
    assert all(si_factor(si_unit(name), name) == 1.0 for name in (*CHANNELS, TIME))


@pytest.mark.parametrize("unit", ["furlong", "", None, 3, ["g"], "rpm"])
def test_a_wrong_unit_names_itself_the_channel_and_the_choices(unit):
    with pytest.raises(InputError, match=r"rod_b_axial choose from .*m/s\^2") as caught:
        si_factor(unit, "rod_b_axial", "units.rod_b_axial")
    assert str(caught.value).startswith(f"units.rod_b_axial: {unit!r}")
    assert "\n" not in str(caught.value)


def test_a_unit_of_another_quantity_is_called_that():
    with pytest.raises(InputError, match="measures rad/s"):
        si_factor("rpm", "crank_angle")


def test_a_misspelt_channel_gets_a_suggestion():
    with pytest.raises(InputError, match="did you mean 'rod_b_axial'"):
        require_channel("rod_b_axal")


@pytest.mark.parametrize("name", sorted(TABLE_9))
def test_the_sensor_sets_are_those_of_table_9(name):
    sensors = instantiate(OmegaConf.load(CONF / "sensors" / f"{name}.yaml"))
    assert isinstance(sensors, SensorSet)
    assert sensors.name == name
    assert tuple(CHANNELS[channel].identifier for channel in sensors.channels) == TABLE_9[name]
    assert type(sensors.channels) is tuple


def test_there_is_a_file_for_each_sensor_set_and_no_other():
    placement = {f"placement_c{rank}" for rank in range(1, 6)}  # tests/test_placement_sets.py
    assert {path.stem for path in (CONF / "sensors").glob("*.yaml")} == set(TABLE_9) | placement


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        (["rod_b_axil"], "did you mean 'rod_b_axial'"),
        ([], "no channel is listed"),
        (["rod_b_axial", "rod_b_axial"], "more than once"),
        ("rod_b_axial", "give a list"),
        ([7], "7 is not a channel"),
    ],
)
def test_a_wrong_sensor_set_is_refused(channels, message):
    with pytest.raises(InputError, match=message):
        SensorSet("mine", channels)
