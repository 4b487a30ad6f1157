"""What sets of channels leave unknown: against dense least squares and closed forms."""

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.detectability import follower_on_path
from clearance.diagnosis.judging.placement import Conditions, _information, expected_errors, subsets
from clearance.diagnosis.sensing.measured import SAMPLES
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.sensors import Sensor, SensorChain

SETTING = Setting(SliderCrank(), "C")
QUIET = SensorChain(default=Sensor(noise_density=1e-3))


def conditions(sensors=QUIET, **changes):
    plain = dict(
        clearances=[3e-4], speeds=[700.0], clearance_range=(0.0, 1e-3), speed_range=(500.0, 1000.0),
        sensors=sensors, chain=MeasurementChain(), window=0.02,
    )  # fmt: skip
    return Conditions(**plain | changes)


def errors(sets, sensors=QUIET):
    return expected_errors(SETTING, sets, conditions(sensors), 1, progress=False)[:, 0, 0]


def test_sets_of_all_sizes():
    assert subsets(("a", "b", "c"), 2) == [("a",), ("b",), ("c",), ("a", "b"), ("a", "c"), ("b", "c")]
    assert len(subsets(ACCELERATIONS, 4)) == 10 + 45 + 120 + 210


def test_a_window_tells_what_dense_least_squares_over_all_its_states_tells():
    model = SETTING.model()
    values = np.array([3e-4, 700.0])
    machine = model.machine(values)
    follower = follower_on_path(machine)
    seen = follower.look(machine, model.columns(values)[0], forces=False)
    part = np.tile([name.startswith("rod") for name in ACCELERATIONS], SAMPLES)
    window, doubt = slice(10, 18), seen.chart.doubt(follower.path.nodes[10])
    flow, _, _, own, _, _, jacobian, sensitivity, _ = (one[window] for one in seen.system)
    n, nv = len(flow), jacobian.shape[3]
    rows = [np.hstack([np.diag(1.0 / doubt), np.zeros((nv, (n - 1) * nv + 2))])]
    for k in range(n - 1):
        row = np.zeros((nv, n * nv + 2))
        row[:, k * nv : (k + 1) * nv] = -flow[k, :, :nv]
        row[:, (k + 1) * nv : (k + 2) * nv] = own[k + 1]
        row[:, n * nv :] = -flow[k, :, nv:]
        rows.append(row)
    for k in range(1, n - 1):
        row = np.zeros((int(part.sum()), n * nv + 2))
        for side, block in ((-1, 2), (0, 1), (1, 0)):
            row[:, (k + side) * nv : (k + side + 1) * nv] = jacobian[k + side, block][part]
        row[:, n * nv :] = sensitivity[k][part]
        rows.append(row)
    whole = np.vstack(rows)
    states, parameters = whole[:, : n * nv], whole[:, n * nv :]
    left = parameters - states @ np.linalg.lstsq(states, parameters, rcond=None)[0]
    assert _information(seen, part, window, doubt)[:2, :2] == pytest.approx(left.T @ left, rel=1e-6)


def test_a_sensor_that_feels_nothing_leaves_the_clearance_where_it_was():
    # the normal law with the variance of a uniform draw over 1 mm
    silent = errors([["slider_vertical"], ["crank_a_axial"]])
    assert silent == pytest.approx(np.sqrt(2.0 / np.pi) * 1e-3 / np.sqrt(12.0), rel=1e-6)


def test_more_sensors_never_tell_less_and_twice_the_noise_half_as_much():
    nested = [ACCELERATIONS[9:], ACCELERATIONS[6:7] + ACCELERATIONS[9:], ACCELERATIONS[4:], ACCELERATIONS]
    found = errors(nested)
    assert (np.diff(found) < 0.0).all()
    assert found[0] < 1e-6
    louder = errors(nested, SensorChain(default=Sensor(noise_density=2e-3)))
    assert louder == pytest.approx(2.0 * found, rel=1e-2)


def test_what_is_told_is_that_of_the_chain():
    rod = [ACCELERATIONS[4:8]]
    chains = (MeasurementChain(1e5, 50, cutoff=0.5), MeasurementChain(2e4, 10, cutoff=0.5))
    finer, coarser = (
        expected_errors(SETTING, rod, conditions(chain=chain), 1, progress=False)[0, 0, 0] for chain in chains
    )
    assert finer > 1.2 * errors(rod)[0]  # 500 Hz of the rod's motion instead of 4 kHz
    # the same filter behind steps as fine, of which a fifth is kept
    assert coarser == pytest.approx(finer, rel=0.05)


def test_noise_may_be_a_share_of_each_channels_signal_or_the_same_for_all():
    both = SensorChain(default=Sensor(noise=0.03, noise_density=4e-4))
    assert conditions(both).noise(np.full(10, 10.0), 2e4) == pytest.approx(np.hypot(0.3, 0.04))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensors": SensorChain()}, "sensor_chain"),
        ({"window": 1.0}, "window"),
        ({"clearances": [0.0]}, "clearances"),
        ({"speeds": 700.0}, "speeds"),
        ({"speed_range": (900.0,)}, "speed_range"),
        ({"clearance_range": (1e-3, 0.0)}, "clearance_range"),
    ],
)
def test_wrong_conditions_are_named(changes, words):
    with pytest.raises(InputError, match=words):
        conditions(**changes)
