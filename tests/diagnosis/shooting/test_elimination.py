"""Least squares along a chain: the same numbers as one dense least squares, and honest innovations."""

from dataclasses import dataclass

import numpy as np
import pytest

from clearance.diagnosis.shooting.elimination import draw, eliminate, substitute


@dataclass
class Chain:
    """Arguments of ``eliminate`` for a chain of segments, and what it writes."""

    flow: np.ndarray
    defect: np.ndarray
    inputs: np.ndarray
    own: np.ndarray
    prior: np.ndarray
    damping: np.ndarray
    jacobian: np.ndarray
    sensitivity: np.ndarray
    residual: np.ndarray

    def __post_init__(self):
        n, rows, parameters = self.sensitivity.shape
        nv = self.jacobian.shape[3]
        self.kept = np.zeros((n, nv, 3 * nv + parameters + 1))
        self.gram = np.zeros((parameters + 1, parameters + 1))
        self.parts = np.zeros((n, parameters))
        self.innovation, self.spread = np.zeros((n, rows)), np.zeros((n, rows))

    def solve(self):
        """Parameters and (segments, nv) states."""
        eliminate(
            self.flow, self.defect, self.inputs, self.own, self.prior, self.damping, self.jacobian,
            self.sensitivity, self.residual, self.kept, self.gram, self.parts, self.innovation, self.spread,
        )  # fmt: skip
        found = np.linalg.solve(self.gram[:-1, :-1], self.gram[:-1, -1])
        states = np.zeros(self.kept.shape[:2])
        substitute(self.kept, found, states)
        return found, states

    def dense(self):
        """All rows of the problem as one matrix and one right-hand side; unknowns: states, parameters."""
        n, nz = self.defect.shape
        nv, parameters = self.jacobian.shape[3], self.sensitivity.shape[2]
        rows, right = [], []

        def add(blocks, own, value):
            row = np.zeros(n * nv + parameters)
            for segment, block in blocks:
                row[segment * nv : segment * nv + len(block)] = block
            row[n * nv :] = own
            rows.append(row)
            right.append(value)

        for j in range(nz):
            add([(0, np.eye(nv)[j] / self.prior[j])], 0.0, 0.0)
        for k in range(n):
            for j in range(nv):
                add([(k, np.eye(nv)[j] * self.damping[k, j])], 0.0, 0.0)
            for j in range(nz, nv):
                add([(k, np.eye(nv)[j])], 0.0, -self.inputs[k, j - nz])
        for k in range(n - 1):
            for i in range(nz):
                add(
                    [(k, -self.flow[k, i, :nv]), (k + 1, self.own[k + 1, i])],
                    -self.flow[k, i, nv:],
                    self.defect[k, i],
                )
        for k in range(1, n - 1):
            for i in range(self.residual.shape[1]):
                add(
                    [(m, self.jacobian[m, k - m + 1, i]) for m in (k - 1, k, k + 1)],
                    self.sensitivity[k, i],
                    self.residual[k, i],
                )
        return np.array(rows), np.array(right)


def random_chain(seed=0, segments=9, nz=4, nw=2, parameters=3, rows=5, damping=0.0):
    rng = np.random.default_rng(seed)
    nv = nz + nw
    return Chain(
        flow=rng.normal(size=(segments, nz, nv + parameters)),
        defect=rng.normal(size=(segments, nz)),
        inputs=rng.normal(size=(segments, nw)),
        own=rng.normal(size=(segments, nz, nz)) + 2.0 * np.eye(nz),
        prior=rng.uniform(0.5, 3.0, nz),
        damping=damping * rng.uniform(0.5, 1.5, (segments, nv)),
        jacobian=rng.normal(size=(segments, 3, rows, nv)),
        sensitivity=rng.normal(size=(segments, rows, parameters)),
        residual=rng.normal(size=(segments, rows)),
    )


SIZES = [
    {},
    {"seed": 1, "segments": 4, "rows": 12},
    {"seed": 2, "nw": 0, "parameters": 1},
    {"seed": 3, "segments": 30, "nz": 2, "nw": 1, "rows": 7},
]


@pytest.mark.parametrize("size", SIZES)
def test_solution_is_that_of_dense_least_squares(size):
    chain = random_chain(**size)
    found, states = chain.solve()
    matrix, right = chain.dense()
    expected = np.linalg.lstsq(matrix, right, rcond=None)[0]
    # both are backward stable: an error of rounding times the condition, some 1e3 here
    np.testing.assert_allclose(states.ravel(), expected[: states.size], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found, expected[states.size :], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("size", SIZES)
def test_gram_is_what_states_cannot_explain(size):
    chain = random_chain(**size)
    found, states = chain.solve()
    matrix, right = chain.dense()
    of_states, rest = matrix[:, : states.size], np.column_stack([matrix[:, states.size :], right])
    left = rest - of_states @ np.linalg.lstsq(of_states, rest, rcond=None)[0]
    np.testing.assert_allclose(chain.gram, left.T @ left, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(chain.parts.sum(axis=0), chain.gram[:-1, -1], rtol=1e-9, atol=1e-9)
    squares = ((matrix @ np.concatenate([states.ravel(), found]) - right) ** 2).sum()
    assert chain.gram[-1, -1] - chain.gram[:-1, -1] @ found == pytest.approx(squares, rel=1e-9)


def test_determinant_of_the_kept_triangle_is_that_of_the_states_information():
    chain = random_chain()
    _, states = chain.solve()
    of_states = chain.dense()[0][:, : states.size]
    nv = states.shape[1]
    diagonal = np.abs(chain.kept[:, np.arange(nv), np.arange(nv)])
    assert 2.0 * np.log(diagonal).sum() == pytest.approx(np.linalg.slogdet(of_states.T @ of_states)[1])


@pytest.mark.parametrize("size", SIZES)
def test_draws_are_as_likely_as_the_numbers_they_are_made_of(size):
    chain = random_chain(**size)
    _, states = chain.solve()
    of_states = chain.dense()[0][:, : states.size]
    drawn = draw(chain.kept, np.random.default_rng(5)).ravel()
    numbers = np.random.default_rng(5).normal(size=states.shape)
    assert ((of_states @ drawn) ** 2).sum() == pytest.approx((numbers**2).sum(), rel=1e-9)


def test_damping_holds_states_as_further_rows():
    chain = random_chain(damping=1.0)
    found, states = chain.solve()
    matrix, right = chain.dense()
    given = right - matrix[:, states.size :] @ found
    expected = np.linalg.lstsq(matrix[:, : states.size], given, rcond=None)[0]
    np.testing.assert_allclose(states.ravel(), expected, rtol=1e-9, atol=1e-9)


def test_damped_parameters_are_those_of_dense_least_squares():
    chain = random_chain(damping=1.0)
    found, states = chain.solve()
    matrix, right = chain.dense()
    expected = np.linalg.lstsq(matrix, right, rcond=None)[0]
    np.testing.assert_allclose(found, expected[states.size :], rtol=1e-9, atol=1e-9)


def test_strong_damping_leaves_states_where_they_are():
    _, states = random_chain(damping=1e6).solve()
    assert np.abs(states).max() < 1e-9


def linear_gaussian(seed, segments=400, nz=3, nw=1, rows=4, noise=1.0):
    """A chain whose residuals come from the very model: states, forces and noise drawn from their priors."""
    rng = np.random.default_rng(seed)
    chain = random_chain(seed + 100, segments, nz, nw, 1, rows)
    chain.flow[:, :, :nz] *= 0.4  # a stable chain
    chain.inputs[:] = 0.0
    state = np.zeros((segments, nz + nw))
    state[:, nz:] = rng.normal(size=(segments, nw))
    state[0, :nz] = chain.prior * rng.normal(size=nz)
    for k in range(segments - 1):
        # own x(k+1) = flow x(k) + defect + process noise of one
        right = chain.flow[k, :, : nz + nw] @ state[k] + chain.defect[k] + rng.normal(size=nz)
        state[k + 1, :nz] = np.linalg.solve(chain.own[k + 1], right)
    for k in range(1, segments - 1):
        chain.residual[k] = noise * rng.normal(size=rows)
        for m in (k - 1, k, k + 1):
            chain.residual[k] += chain.jacobian[m, k - m + 1] @ state[m]
    return chain, state


@pytest.mark.parametrize("seed", range(3))
def test_innovations_of_the_right_model_have_the_stated_spread(seed):
    chain, _ = linear_gaussian(seed)
    chain.solve()
    ratio = (chain.innovation / np.where(chain.spread > 0.0, chain.spread, 1.0))[1:-1]
    assert (chain.spread[1:-1] >= 1.0).all()
    # innovations of different blocks are independent; the rows of a block are not: as if it had one row
    assert (ratio**2).mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(ratio)))
    assert abs((ratio[:-1] * ratio[1:]).mean()) < 4.0 / np.sqrt(len(ratio))


def test_innovations_of_twice_the_noise_are_too_large():
    chain, _ = linear_gaussian(0, noise=2.0)
    chain.solve()
    spread = chain.spread[1:-1]
    # of the spread one square is noise, of four times its size; what is foreseen from it is off by more, too
    least, most = 1.0 + 3.0 * np.mean(1.0 / spread**2), 4.0
    found = ((chain.innovation[1:-1] / spread) ** 2).mean()
    assert 1.2 < least < found + 4.0 * least * np.sqrt(2.0 / len(spread))
    assert found < most


def test_states_lie_within_their_uncertainty():
    chain, state = linear_gaussian(5, segments=200)
    chain.solve()
    found = np.zeros_like(state)
    substitute(chain.kept, np.zeros(1), found)
    matrix = chain.dense()[0][:, : state.size]
    deviation = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix))).reshape(state.shape)
    # neighbours share their errors over a few segments: count one independent state a segment
    assert (((found - state) / deviation) ** 2).mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 200))
