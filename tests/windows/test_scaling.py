import json

import numpy as np
import pytest
import torch

from clearance.errors import InputError
from clearance.windows.scaling import MinMaxScaler, Scalers, StandardScaler


def test_scaled_channels_have_zero_mean_and_unit_deviation():
    signals = np.random.default_rng(0).normal([3.0, -200.0], [0.5, 90.0], (5000, 2)).astype(np.float32)
    scaled = StandardScaler.fit(("a", "b"), [signals[:2000], signals[2000:]]).transform(signals)
    assert np.allclose(scaled.mean(axis=0), 0, atol=1e-5)  # single precision
    assert np.allclose(scaled.std(axis=0), 1, atol=1e-5)


@pytest.mark.parametrize("level", [0.0, 9.81, -1e-12])
def test_constant_channels_survive(level):
    signals = np.full((100, 1), level, dtype=np.float32)
    scaler = StandardScaler.fit(("slider_vertical",), [signals])
    assert scaler.constant == (True,)
    assert np.allclose(scaler.transform(signals), 0)
    assert np.allclose(scaler.transform(signals + 2), 2)  # what deviates later stays visible, in its own unit


def test_nan_is_refused_by_name():
    signals = np.array([[1.0, np.nan], [2.0, 3.0]], dtype=np.float32)
    with pytest.raises(InputError, match="rod_b_axial"):
        StandardScaler.fit(("rod_b_transverse", "rod_b_axial"), [signals])


def test_target_goes_to_unit_range_and_back():
    values = np.array([[2e-4, 0.0], [9e-4, 3e-4], [5e-4, 1e-4]])
    scaler = MinMaxScaler.fit(values)
    scaled = scaler.transform(values)
    assert scaled.min(axis=0).tolist() == [0, 0]
    assert scaled.max(axis=0).tolist() == [1, 1]
    assert np.allclose(scaler.inverse(scaled), values, rtol=1e-14)
    single = scaler.metres(torch.from_numpy(scaled.astype(np.float32)))
    assert np.allclose(single.numpy(), values, rtol=1e-6)  # single precision


def test_one_clearance_cannot_be_scaled():
    with pytest.raises(InputError, match="two different"):
        MinMaxScaler.fit(np.array([[1e-4, 1e-4], [2e-4, 1e-4]]))


def test_json_keeps_every_bit():
    signals = np.random.default_rng(1).normal(size=(50, 2)).astype(np.float32)
    scalers = Scalers(
        StandardScaler.fit(("a", "b"), [signals]), MinMaxScaler((1e-5 / 3, 0.0), (1e-3 / 7, 1e-3))
    )
    assert Scalers.from_json(json.loads(json.dumps(scalers.to_json()))) == scalers
