import io

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from clearance.errors import InputError
from clearance.recording.matlab import variables

KINDS = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")


def saved(content, compressed):
    stream = io.BytesIO()
    scipy.io.savemat(stream, content, do_compression=compressed)
    return stream.getvalue()


def by_name(content, largest=10**6):
    return {variable.name: variable for variable in variables(content, largest)}


@given(
    array=st.sampled_from(KINDS).flatmap(
        lambda kind: arrays(kind, array_shapes(min_dims=2, max_dims=3, max_side=9))
    ),
    compressed=st.booleans(),
)
@settings(deadline=None, max_examples=100)
def test_what_scipy_writes_is_read_as_it_was(array, compressed):
    variable = by_name(saved({"x": array, "a_longer_name": np.ones((1, 3))}, compressed))["x"]
    assert variable.shape == array.shape
    np.testing.assert_array_equal(variable.values, array.astype(np.float64).ravel(order="F"))


@pytest.mark.parametrize("compressed", [True, False])
def test_everything_but_real_numbers_is_refused_with_its_kind(compressed):
    other = {
        "text": "abc",
        "record": {"field": 1.0},
        "cells": np.array([1.0, "b"], dtype=object),
        "complex": np.ones(3) * 1j,
        "flags": np.ones(3, dtype=bool),
        "sparse": scipy.sparse.eye_array(3, format="csc"),
    }
    found = by_name(saved(other, compressed))
    assert all(found[name].values is None for name in other)
    assert found["text"].refusal == "is a MATLAB char, not numbers"
    assert found["record"].refusal == "is a MATLAB struct, not numbers"
    assert found["cells"].refusal == "is a MATLAB cell, not numbers"
    assert found["complex"].refusal == found["flags"].refusal == "does not hold real numbers"


def test_a_variable_that_unpacks_to_too_much_is_refused():
    content = saved({"x": np.zeros((1, 100_000))}, True)
    assert len(content) < 2000
    with pytest.raises(InputError, match="larger than 1000 bytes"):
        by_name(content, largest=1000)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "does not begin as a MATLAB file"),
        (b"x" * 500, "does not begin as a MATLAB file"),
        (b"MATLAB 5.0 MAT-file".ljust(128), "byte order"),
        (saved({"x": np.ones((1, 9))}, False)[:-5], "cut off"),
        (saved({"x": np.ones((1, 9))}, True)[:-5], "cut off"),
    ],
)
def test_a_foreign_or_shortened_file_is_refused(content, message):
    with pytest.raises(InputError, match=message):
        by_name(content)
