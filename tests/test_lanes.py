"""Lanes compute what floats compute, and never look at each other."""

import numpy as np
import pytest

from clearance.compilation import entry
from clearance.lanes import (
    WIDTH,
    absolute,
    any_lane,
    arcsine,
    exponential,
    get,
    maximum,
    minimum,
    nearest_integer,
    put,
    sine_cosine,
    square_root,
    where,
    zero,
)


@entry
def arithmetic(a, out):
    x, y = get(a, 0), get(a, 1)
    put(out, 0, x + y * 2.0)
    put(out, 1, (1 - x) / y)
    put(out, 2, -x)
    put(out, 3, where((x > y) | (x < -1.0), x, y))
    put(out, 4, maximum(x, y) - minimum(x, y))
    put(out, 5, square_root(absolute(x)))
    put(out, 6, nearest_integer(x))
    put(out, 7, exponential(-absolute(x)) + arcsine(x / (1.0 + absolute(x))))
    total = zero(x)
    for _ in range(3):
        total += x
    put(out, 8, total)
    put(out, 9, where((x >= y) & (x <= 2.0), 1.0 + zero(x), 2.0 + zero(x)))
    put(out, 10, where((x == y) & (x != 5.0), 1.0 + zero(x), 3.0 + zero(x)))


@entry
def trigonometry(a, out):
    sine, cosine = sine_cosine(get(a, 0))
    put(out, 0, sine)
    put(out, 1, cosine)


@entry
def any_positive(a):
    return any_lane(get(a, 0) > 0.0)


def expected(x, y):
    return np.array(
        [
            x + 2 * y,
            (1 - x) / y,
            -x,
            np.where((x > y) | (x < -1), x, y),
            np.abs(x - y),
            np.sqrt(np.abs(x)),
            np.rint(x),
            np.exp(-np.abs(x)) + np.arcsin(x / (1 + np.abs(x))),
            3 * x,
            np.where((x >= y) & (x <= 2), 1.0, 2.0),
            np.where((x == y) & (x != 5.0), 1.0, 3.0),
        ]
    )


def test_lanes_compute_what_numpy_computes():
    a = np.random.default_rng(0).normal(size=(2, WIDTH)) * 3
    a[1, 0] = a[0, 0]
    out = np.zeros((11, WIDTH))
    arithmetic(a, out)
    np.testing.assert_allclose(out, expected(*a), rtol=1e-15, atol=1e-15)


def test_one_float_computes_what_a_lane_computes():
    a = np.random.default_rng(1).normal(size=(2, WIDTH)) * 3
    together = np.zeros((11, WIDTH))
    arithmetic(a, together)
    for lane in range(WIDTH):
        alone = np.zeros(11)
        arithmetic(np.ascontiguousarray(a[:, lane]), alone)
        np.testing.assert_allclose(alone, together[:, lane], rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize("scale", [1.0, 100.0, 1e5])
def test_sine_and_cosine_are_within_rounding(scale):
    angles = np.random.default_rng(2).uniform(-scale, scale, size=(200, WIDTH))
    out = np.zeros((2, WIDTH))
    for row in angles:
        trigonometry(row[None], out)
        np.testing.assert_allclose(out[0], np.sin(row), rtol=0, atol=4e-16)
        np.testing.assert_allclose(out[1], np.cos(row), rtol=0, atol=4e-16)


def test_a_lane_that_is_not_a_number_stays_alone():
    a = np.ones((2, WIDTH))
    a[0, 3] = np.nan
    out = np.zeros((11, WIDTH))
    arithmetic(a, out)
    assert np.isnan(out[:3, 3]).all()
    assert np.isfinite(np.delete(out, 3, axis=1)).all()


def test_any_lane():
    a = -np.ones((1, WIDTH))
    assert not any_positive(a)
    a[0, WIDTH - 1] = 1.0
    assert any_positive(a)
