import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clearance.errors import InputError
from clearance.recording.files import read, write
from clearance.recording.recording import Recording
from clearance.recording.sensors import Sensor, declared_chain

from .formats import RATE, SAMPLES, TIME, B, columns, declare, read_or_complain, write_csv

PROPERTY = settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "run.csv"
    write_csv(path, columns())
    return path


def test_the_declaration_maps_converts_and_describes(tmp_path):
    path = tmp_path / "run.csv"
    write_csv(path, {"t": TIME * 1e3, "acc 1": B, "angle": TIME * 360.0, "note": ["x"] * SAMPLES})
    path.with_suffix(".yaml").write_text(
        """
        columns: {t: time, acc 1: rod_b_axial, angle: crank_angle}
        ignore: [note, absent]
        units: {time: ms, rod_b_axial: g, crank_angle: deg}
        scale: {rod_b_axial: -1e0}
        sensors: {rod_b_axial: {position: 0.01, mounting_angle: 2, gain: 1.02, noise: 1e-3}}
        chain: {base_rate: 1e4, decimation: 10, filter_order: 8, ripple_db: 0.05, cutoff: 0.8}
        metadata: {machine: press 7}
        """
    )
    recording = read(path)
    assert recording.rate == RATE
    np.testing.assert_allclose(recording.channel("rod_b_axial"), -9.80665 * B)
    np.testing.assert_allclose(recording.channel("crank_angle"), TIME * 2 * np.pi, rtol=1e-15)
    assert recording.metadata == {
        "machine": "press 7",
        "sensors": {"rod_b_axial": {"position": 0.01, "mounting_angle": 2.0, "gain": 1.02, "noise": 1e-3}},
        "chain": {"base_rate": 1e4, "decimation": 10, "filter_order": 8, "ripple_db": 0.05, "cutoff": 0.8},
    }
    assert declared_chain(recording).sensor("rod_b_axial") == Sensor(
        gain=1.02, mounting_angle=2.0, noise=1e-3
    )
    write(recording, tmp_path / "copy.parquet")
    assert read(tmp_path / "copy.parquet").metadata == recording.metadata


def test_the_declaration_adds_to_what_the_file_itself_says(tmp_path):
    own = {
        "sensors": {"rod_b_axial": {"gain": 1.1, "bias": 0.2}, "rod_c_axial": {"gain": 0.9}},
        "chain": {"base_rate": 5e3, "decimation": 5},
    }
    values = np.random.default_rng(0).normal(size=(SAMPLES, 2))
    write(Recording(values, ("rod_b_axial", "rod_c_axial"), 1e3, 0.0, own), tmp_path / "run.parquet")
    declare(tmp_path / "run.parquet", sensors={"rod_b_axial": {"bias": 0.3}}, chain={"ripple_db": 0.1})
    assert read(tmp_path / "run.parquet").metadata == {
        "sensors": {"rod_b_axial": {"gain": 1.1, "bias": 0.3}, "rod_c_axial": {"gain": 0.9}},
        "chain": {"base_rate": 5e3, "decimation": 5, "ripple_db": 0.1},
    }


@pytest.mark.parametrize("sensors", [[1], {"rod_b_axial": None}])
def test_sensors_in_the_file_that_are_no_mapping_are_a_damaged_header(tmp_path, sensors):
    recording = Recording(np.zeros((SAMPLES, 1)), ("rod_b_axial",), 1e3, 0.0, {"sensors": sensors})
    write(recording, tmp_path / "run.parquet")
    with pytest.raises(InputError, match="header under 'clearance' in its schema is damaged"):
        read(tmp_path / "run.parquet")


@pytest.mark.parametrize("chain", [{"base_rate": None}, {"base_rate": "100 kHz"}, {"decimation": 0}])
def test_a_chain_in_the_file_that_no_chain_can_be_is_a_damaged_header(tmp_path, chain):
    recording = Recording(np.zeros((SAMPLES, 1)), ("rod_b_axial",), 1e3, 0.0, {"chain": chain})
    write(recording, tmp_path / "run.parquet")
    with pytest.raises(InputError, match="header under 'clearance' in its schema is damaged"):
        read(tmp_path / "run.parquet")


@pytest.mark.parametrize("key", ["units", "scale"])
def test_a_unit_or_scale_of_a_channel_that_the_file_lacks_is_refused(csv, key):
    declare(csv, **{key: {"slider_vertical": "g" if key == "units" else 2.0}})
    with pytest.raises(InputError, match=rf"{key}\.slider_vertical in run\.yaml: the file has no"):
        read(csv)


def test_a_rate_stands_in_for_a_time_column(tmp_path):
    write_csv(tmp_path / "run.csv", {"rod_b_axial": B})
    recording = read(declare(tmp_path / "run.csv", rate="2.5e3"))
    assert (recording.rate, recording.start_time) == (2500.0, 0.0)


def test_an_empty_declaration_declares_nothing(csv):
    csv.with_suffix(".yml").write_text("# nothing yet\n")
    assert read(csv).metadata == {}


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"unit": {}}, "unknown key 'unit'; did you mean 'units'.*allowed keys are columns, ignore"),
        ({"units": {"rod_b_axial": "furlong"}}, "units.rod_b_axial: 'furlong' is not a known unit"),
        ({"units": {"rod_b_axial": "rpm"}}, "is not a unit of rod_b_axial but measures rad/s"),
        (
            {"units": {"rod_b_axil": "g"}},
            "units.rod_b_axil: 'rod_b_axil' is not a channel; did you mean 'rod_b_axial'",
        ),
        ({"units": ["g"]}, "units: .* is not a mapping"),
        ({"columns": {"rod_b_axial": "acc"}}, "columns.rod_b_axial: 'acc' is not a channel"),
        ({"columns": {"acc": "crank_angle"}}, "maps the column 'acc', but the file has time, rod_b_axial"),
        ({"columns": {"rod_c_axial": "rod_b_axial"}}, "'rod_b_axial' and 'rod_c_axial' are both rod_b_axial"),
        ({"columns": {1: "rod_b_axial"}}, "the name 1 is not text"),
        ({"ignore": "time"}, "ignore: 'time' is not a list"),
        ({"scale": {"rod_b_axial": "much"}}, "scale.rod_b_axial: 'much' is not a number"),
        ({"scale": {"rod_b_axial": 0}}, "scale.rod_b_axial: 0 loses the signal"),
        ({"rate": 5}, "rate: 5 Hz is out of range; give a number from 20 to 1e"),
        ({"rate": 900}, "900 Hz contradicts the column 'time', which gives 1000 Hz"),
        (
            {"sensors": {"rod_b_axial": {"gian": 1}}},
            "sensors.rod_b_axial: unknown key gian; did you mean 'gain'",
        ),
        (
            {"sensors": {"rod_b_axial": {"noise": -1}}},
            "sensors.rod_b_axial: sensor noise: -1 .* is out of range",
        ),
        (
            {"sensors": {"rod_b_axial": {"position": 99}}},
            "sensors.rod_b_axial.position: 99 m is out of range",
        ),
        ({"sensors": {"crank_angle": {"mounting_angle": 9}}}, "only accelerations have a mounting angle"),
        ({"chain": {"order": 8}}, "chain: unknown key 'order'; .*filter_order"),
        ({"chain": {"filter_order": 7.5}}, "chain.filter_order: 7.5 is not whole"),
        ({"chain": {"filter_order": 7}}, "chain.filter_order = 7 is odd"),
        ({"chain": {"decimation": 201}}, "chain.decimation: 201 is out of range; .* from 1 to 200"),
        ({"chain": {"cutoff": 1.0}}, "chain.cutoff: 1 of the Nyquist .* is out of range; .* 0.05 to 0.95"),
        (
            {"chain": {"base_rate": 1e5, "decimation": 10}},
            "decimation is 10000 Hz, the recording has 1000 Hz",
        ),
        (
            {"metadata": {"sensors": "PCB 352C33"}},
            "metadata.sensors: this name is kept for what sensors decl",
        ),
        ({"metadata": 7}, "metadata: '7' is not a mapping"),
    ],
)
def test_a_wrong_declaration_is_one_line_that_names_the_key(csv, keys, message):
    with pytest.raises(InputError, match=message) as caught:
        read(declare(csv, **keys))
    assert "\n" not in str(caught.value)
    assert str(csv.with_suffix("")) in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "columns: {a: [",
        "!!python/object/apply:os.mkdir [executed]",
        "7",
        "? [1]\n: 2",
        "a: 2020-99-99",
        "\x00",
    ],
)
def test_what_is_no_yaml_is_refused_and_never_executed(csv, text, monkeypatch):
    monkeypatch.chdir(csv.parent)
    csv.with_suffix(".yaml").write_text(text)
    with pytest.raises(InputError, match=r"run\.yaml"):
        read(csv)
    assert not (csv.parent / "executed").exists()


def test_two_declarations_are_one_too_many(csv):
    for suffix in (".yaml", ".yml"):
        csv.with_suffix(suffix).write_text("rate: 1000")
    with pytest.raises(InputError, match="keep one of the two"):
        read(csv)


@given(st.binary(max_size=300))
@PROPERTY
def test_any_bytes_as_a_declaration_are_read_or_one_line(tmp_path, content):
    write_csv(tmp_path / "run.csv", columns())
    (tmp_path / "run.yaml").write_bytes(content)
    outcome = read_or_complain(tmp_path / "run.csv")
    assert isinstance(outcome, Recording) or "\n" not in outcome
