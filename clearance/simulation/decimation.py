"""Zero-phase low-pass filtering and decimation in the same pass as the simulation.

A recursive filter run forwards and backwards has a two-sided impulse response that is a sum of decaying
exponentials, g(n) = d [n=0] + sum_i c_i p_i^|n|. Each exponential is one complex running sum per direction,
so that only one state a pole and decimated sample has to be kept for the backward direction, and the signal
at full rate is never stored. Equivalent to ``scipy.signal.sosfiltfilt`` followed by decimation, away from a
record's ends.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from clearance.compilation import kernel
from clearance.lanes import get, put

TAIL = 1e-9  # of the impulse response that may be cut


@dataclass(frozen=True)
class Decimation:
    """Coefficients of a zero-phase decimating filter.

    Attributes:
        factor: samples at full rate for each decimated one.
        weights: (4, poles, factor) weights of a block's samples in the running sums: forward real and
            imaginary, backward real and imaginary.
        decay: (2, poles) a pole's power over one block, real and imaginary.
        residues: (2, poles) twice c_i, real and imaginary (conjugate pairs are counted once).
        rest: (2, poles) running sum of a constant signal of one, real and imaginary.
        direct: d.
        chunk: decimated samples after which the impulse response is below ``TAIL``.
    """

    factor: int
    weights: np.ndarray
    decay: np.ndarray
    residues: np.ndarray
    rest: np.ndarray
    direct: float
    chunk: int

    @staticmethod
    def none() -> "Decimation":
        """Every sample, unfiltered."""
        empty = np.zeros((2, 0))
        return Decimation(1, np.zeros((4, 0, 1)), empty, empty, empty, 1.0, 64)

    @staticmethod
    def chebyshev(factor: int, order: int, ripple_db: float, cutoff: float) -> "Decimation":
        """Chebyshev type I of even order, unit gain at zero frequency.

        Args:
            factor: samples at full rate for each decimated one.
            order: even, so that all poles come in conjugate pairs.
            ripple_db: passband ripple of one direction [dB].
            cutoff: as a fraction of the Nyquist frequency after decimation.
        """
        # Analogue prototype, warped to the cut-off and taken to discrete time by the bilinear transformation
        # (Oppenheim & Schafer, ch. 7); SciPy's design gives the same, but its import costs a second.
        angle = np.pi * (2 * np.arange(order) + 1) / (2 * order)
        bend = np.arcsinh(1.0 / np.sqrt(10.0 ** (ripple_db / 10.0) - 1.0)) / order
        analogue = -np.sinh(bend) * np.sin(angle) + 1j * np.cosh(bend) * np.cos(angle)
        analogue *= np.tan(0.5 * np.pi * cutoff / factor)
        poles, zeros = (1.0 + analogue) / (1.0 - analogue), -np.ones(order)
        gain = float((np.prod(1.0 - poles) / np.prod(1.0 - zeros)).real)
        upper = poles[poles.imag > 0.0]

        def other_factors(p: complex) -> complex:
            """H(z) H(1/z) (z - p) / z at z = p."""
            own = np.prod([p - q for q in poles if q != p])
            forward = np.prod(p - zeros) / own
            mirrored = np.prod(1.0 / p - zeros) / np.prod(1.0 / p - poles)
            return gain * gain * forward * mirrored / p

        residues = np.array([2.0 * other_factors(p) for p in upper])
        direct = float((gain * gain * np.prod(-zeros) / np.prod(-poles)).real)
        m = np.arange(1, factor + 1)
        forward = upper[:, None] ** (factor - m)
        backward = upper[:, None] ** m
        decay = upper**factor
        rest = 1.0 / (1.0 - upper)
        chunk = int(np.ceil(np.log(TAIL) / np.log(np.abs(decay).max())))
        return Decimation(
            factor,
            np.ascontiguousarray(np.stack([forward.real, forward.imag, backward.real, backward.imag])),
            np.stack([decay.real, decay.imag]),
            np.stack([residues.real, residues.imag]),
            np.stack([rest.real, rest.imag]),
            direct,
            chunk,
        )


@kernel
def start_sums(sums: Any, row: int, value: Any, rest: Any) -> None:
    """Running sums of a signal that was constant until now."""
    for i in range(rest.shape[1]):
        put(sums, row + 2 * i, value * rest[0, i])
        put(sums, row + 2 * i + 1, value * rest[1, i])


@kernel
def forward_output(sums: Any, row: int, value: Any, residues: Any, direct: float) -> Any:
    """What the present and the past contribute to a decimated sample."""
    output = value * direct
    for i in range(residues.shape[1]):
        output = (
            output + get(sums, row + 2 * i) * residues[0, i] - get(sums, row + 2 * i + 1) * residues[1, i]
        )
    return output


@kernel
def absorb_block(
    block: Any, first: int, stride: int, sums: Any, row: int, future: Any, slot: int, weights: Any, decay: Any
) -> None:
    """Take one block of samples into the forward sums, and keep its backward sums.

    Args:
        block: samples; sample m of this channel is row ``first + m * stride``.
        first: see ``block``.
        stride: see ``block``.
        sums: forward running sums from row ``row`` on, updated.
        row: see ``sums``.
        future: backward sums of this block, written from row ``slot`` on.
        slot: see ``future``.
        weights: see ``Decimation``.
        decay: see ``Decimation``.
    """
    factor = weights.shape[2]
    for i in range(weights.shape[1]):
        value = get(block, first)
        forward_re, forward_im = value * weights[0, i, 0], value * weights[1, i, 0]
        back_re, back_im = value * weights[2, i, 0], value * weights[3, i, 0]
        for m in range(1, factor):
            value = get(block, first + m * stride)
            forward_re = forward_re + value * weights[0, i, m]
            forward_im = forward_im + value * weights[1, i, m]
            back_re = back_re + value * weights[2, i, m]
            back_im = back_im + value * weights[3, i, m]
        re, im = get(sums, row + 2 * i), get(sums, row + 2 * i + 1)
        put(sums, row + 2 * i, forward_re + re * decay[0, i] - im * decay[1, i])
        put(sums, row + 2 * i + 1, forward_im + re * decay[1, i] + im * decay[0, i])
        put(future, slot + 2 * i, back_re)
        put(future, slot + 2 * i + 1, back_im)


@kernel
def retreat(future: Any, slot: int, sums: Any, row: int, residues: Any, decay: Any) -> Any:
    """Step the backward sums back by one decimated sample; return what the future contributes to it."""
    output = 0.0 * get(sums, row)
    for i in range(residues.shape[1]):
        re, im = get(sums, row + 2 * i), get(sums, row + 2 * i + 1)
        new_re = get(future, slot + 2 * i) + re * decay[0, i] - im * decay[1, i]
        new_im = get(future, slot + 2 * i + 1) + re * decay[1, i] + im * decay[0, i]
        put(sums, row + 2 * i, new_re)
        put(sums, row + 2 * i + 1, new_im)
        output = output + new_re * residues[0, i] - new_im * residues[1, i]
    return output
