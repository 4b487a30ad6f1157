"""How surely a fit knows its parameters: against the inverse of an information that is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.shooting.covariance import _root, optimism


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


@pytest.mark.parametrize("related", [False, True])
def test_what_parts_that_are_left_out_cost_more_is_told_without_leaving_them_out(related):
    """Two recordings, three shared parameters and one of each's own, against refits without each block."""
    random, block, steps = np.random.default_rng(7), 5, np.array([1e-3, 2.0, 0.1, 5.0])
    rows, shared = np.zeros((2, 200, 5)), random.normal(size=(2, 200, 4)) * [1.0, 30.0, 0.01, 2.0]
    rows[:, :, :3], rows[0, :, 3], rows[1, :, 4] = shared[..., :3], shared[0, :, 3], shared[1, :, 3]
    noise = random.normal(size=(2, 40, 1 if related else block)).repeat(block if related else 1, axis=2)
    target = rows @ [1.0, -2.0, 30.0, 0.5, 0.7] + noise.reshape(2, 200)

    def solved(kept):
        return np.linalg.lstsq(rows[kept], target[kept], rcond=None)[0]

    found = solved(np.full((2, 200), True))
    left = target - rows @ found
    fit = SimpleNamespace(
        model=SimpleNamespace(shared=3, unknowns=[None] * 4, step=lambda _, i: steps[i]),
        values=np.zeros((2, 4)), information=np.einsum("rsi,rsj->ij", rows, rows),
        passes=[SimpleNamespace(parts=shared[r] * left[r, :, None] * steps) for r in range(2)],
    )  # fmt: skip
    without = 0.0
    for r, b in np.ndindex(2, 200 // block):
        kept = np.full((2, 200), True)
        kept[r, block * b : block * (b + 1)] = False
        without += ((target[~kept] - rows[~kept] @ solved(kept)) ** 2).sum()
    assert without > (left**2).sum()
    assert optimism(fit) == pytest.approx(without - (left**2).sum(), rel=0.1)
