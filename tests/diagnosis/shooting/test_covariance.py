"""How surely a fit knows its parameters: against the inverse of an information that is known."""

import numpy as np
import pytest

from clearance.diagnosis.shooting.covariance import _root


def test_what_derivatives_leave_of_an_unseen_direction_is_no_knowledge():
    unit = np.array([1e6, 1.0, 1e-3])
    seen = np.array([[2.0, 1.0, 0.1], [1.0, 3.0, 0.2], [0.1, 0.2, 1.0]])
    information = seen * np.outer(unit, unit)
    root = _root(information)
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(information), rtol=1e-9)
    # the second parameter does what the first does, but for rounding of the derivatives
    twins = np.array([[1.0, 1.0, 0.1], [1.0, 1.0 + 1e-9, 0.1], [0.1, 0.1, 1.0]]) * np.outer(unit, unit)
    deviation = np.linalg.norm(_root(twins), axis=1) * unit
    assert (deviation[:2] > 1e6).all()
    assert deviation[2] == pytest.approx(1.0, rel=0.02)
