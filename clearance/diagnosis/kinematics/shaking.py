"""How the frame moves, and on what kind of springs it stands, from what accelerometers feel.

What all links are accelerated with, the frame has to give: its own mass, damper and springs answer, and the
crank's sensors at A show how it moves. The balance of the two is linear in mass, damping and stiffness. It is
filtered by s²/(s + λ)², so that no signal is differentiated and no integral drifts.

Reference: Garnier and Wang 2008, Identification of Continuous-time Models from Sampled Data, ch. 1 (state
variable filters).
"""

from collections.abc import Sequence

import numpy as np
from scipy.signal import bilinear, lfilter

from clearance.diagnosis.sensing.measured import Measured
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import Link, SliderCrank

AT_A = ("crank_a_axial", "crank_a_transverse")
NEEDED = (
    *AT_A, "crank_b_transverse", "crank_b_axial", "rod_b_transverse",
    "rod_b_axial", "rod_c_transverse", "rod_c_axial", "slider_horizontal",
)  # fmt: skip
"""Channels that tell what all links are accelerated with."""
FOUND = ("frequency", "damping_ratio", "mass")
"""What they tell of the frame, by the names of its effect's parameters."""
_SHOWN = 5.0  # times the noise: what the sensors at A feel of a frame that moves
_CORNER = 100.0  # rad/s, of the filter
_SETTLED = 6.0  # times its time constant, after which it has forgotten how the recording began


def shakes(one: Measured, angle: float, speed: float) -> bool:
    """Whether the crank's sensors at A feel a frame that moves, beside gravity and what they err by.

    Args:
        one: a recording.
        angle: of the crank at its first sample [rad].
        speed: of the crank [rad/s].
    """
    if any(channel not in one.channels for channel in AT_A):
        return False
    at = [one.channels.index(channel) for channel in AT_A]
    axial, across = one.values.reshape(-1, len(one.channels))[:, at].T
    turned = angle + speed * np.arange(len(axial)) / one.chain.rate
    cosine, sine, one_each, none = np.cos(turned), np.sin(turned), np.ones_like(turned), np.zeros_like(turned)
    columns = np.concatenate([
        np.stack([cosine, sine, one_each, none], axis=1), np.stack([-sine, cosine, none, one_each], axis=1),
    ])  # fmt: skip
    felt = np.concatenate([axial, across])
    left = (felt - columns @ np.linalg.lstsq(columns, felt, rcond=None)[0]).reshape(2, -1)
    return bool((left.std(axis=1) > _SHOWN * one.sigma[at]).all())


def measure_frame(
    recordings: Sequence[Measured], turning: Sequence[tuple[float, float]], machine: SliderCrank
) -> np.ndarray | None:
    """(3,) frequency [Hz] and damping ratio of the frame alone, and its mass [kg].

    Args:
        recordings: of one machine.
        turning: angle of the crank at the first sample [rad] and its speed [rad/s] in each.
        machine: whose links they are.

    Returns:
        ``None`` where a channel of ``NEEDED`` is not recorded, or what is found is no frame on springs.
    """
    told = all(channel in one.channels for one in recordings for channel in NEEDED)
    if not told or machine.parameters()[Parameter.SENSOR_CRANK_A] != 0.0:
        return None
    parts = [_balance(one, *turns, machine) for one, turns in zip(recordings, turning, strict=True)]
    rows, right = (np.concatenate(part) for part in zip(*parts, strict=True))
    mass, damping, stiffness, *_ = np.linalg.lstsq(rows, right, rcond=None)[0]
    if not (mass > 0.0 and stiffness > 0.0):
        return None
    ratio = max(damping, 0.0) / (2.0 * np.sqrt(stiffness * mass))
    return np.array([np.sqrt(stiffness / mass) / (2.0 * np.pi), ratio, mass])


def _balance(
    one: Measured, angle: float, speed: float, machine: SliderCrank
) -> tuple[np.ndarray, np.ndarray]:
    """(samples, 5) what mass, damping, stiffness and constants in x and y give; (samples,) what is asked."""
    p = machine.parameters()
    values, rate = one.values.reshape(-1, len(one.channels)), one.chain.rate
    crank = angle + speed * np.arange(len(values)) / rate
    rod = np.arcsin((machine.guide_offset - machine.crank.length * np.sin(crank)) / machine.rod.length)

    def felt(place: str, angle: np.ndarray) -> np.ndarray:
        """(samples,) acceleration as x + iy."""
        axial, across = (values[:, one.channels.index(f"{place}_{way}")] for way in ("axial", "transverse"))
        return (axial + 1j * across) * np.exp(1j * angle)

    def weighed(link: Link, near: np.ndarray, far: np.ndarray, at: np.ndarray) -> np.ndarray:
        """(samples,) mass times the acceleration of its centre, from that of two places on it."""
        share = (link.center_of_mass * link.length - at[0]) / (at[1] - at[0])
        return link.mass * (near + share * (far - near))

    frame = felt("crank_a", crank)
    sliding = values[:, one.channels.index("slider_horizontal")] + 1j * frame.imag
    asked = -(
        weighed(machine.crank, frame, felt("crank_b", crank), p[Parameter.SENSOR_CRANK_A :])
        + weighed(machine.rod, felt("rod_b", rod), felt("rod_c", rod), p[Parameter.SENSOR_ROD_B :])
        + machine.slider.mass * sliding
    )
    skipped = round(_SETTLED / _CORNER * rate)
    below = np.polymul([1.0, _CORNER], [1.0, _CORNER])
    filters = [bilinear(above, below, rate) for above in ([1.0, 0.0, 0.0], [1.0, 0.0], [1.0])]
    columns = [lfilter(*each, frame)[skipped:] for each in filters]
    right = lfilter(*filters[0], asked)[skipped:]
    one_each, none = np.ones(len(right)), np.zeros(len(right))
    rows = np.concatenate([
        np.stack([*(column.real for column in columns), one_each, none], axis=1),
        np.stack([*(column.imag for column in columns), none, one_each], axis=1),
    ])  # fmt: skip
    return rows, np.concatenate([right.real, right.imag])
