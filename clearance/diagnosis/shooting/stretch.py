"""What a look at a stretch of a recording leaves behind: a path, a comparison, a linearisation."""

from dataclasses import dataclass, field, fields

import numpy as np

from clearance.diagnosis.shooting.chart import Chart
from clearance.diagnosis.shooting.elimination import draw, eliminate, substitute
from clearance.mechanism.parameters import Parameter
from clearance.simulation.layout import STATES

INPUTS: tuple[Parameter, ...] = (
    Parameter.FORCE_CRANK_TORQUE,
    Parameter.FORCE_ROD_MOMENT,
    Parameter.FORCE_SLIDER_X,
)
"""Unknown forces, one for each coordinate that the sensors can tell apart."""

OUTLIER = 4.0  # standard deviations beyond which a row loses weight (Huber)


@dataclass
class Path:
    """Where the simulator is on a recording.

    Attributes:
        nodes: (segments, STATES).
        inputs: (segments, inputs) unknown forces [N, N m].
    """

    nodes: np.ndarray
    inputs: np.ndarray

    @staticmethod
    def empty(segments: int) -> "Path":
        """Nothing known yet."""
        return Path(np.zeros((segments, STATES)), np.zeros((segments, len(INPUTS))))

    def copy(self) -> "Path":
        """An independent copy."""
        return Path(self.nodes.copy(), self.inputs.copy())


@dataclass
class Comparison:
    """A stretch of a path beside the recording.

    Attributes:
        chart: the unknowns.
        cost: robust sum of squares, to be compared between looks at the same stretch.
        local: (segments,) its parts.
        residual: (segments, samples, channels) measured minus predicted, in standard deviations of noise.
        values: (segments, samples, channels) measured, faults of instruments undone.
        used: (segments, samples, channels) weight of each residual, 0 at the edges.
        defect: (segments, nz) end minus next node, in process noise.
        contacts: (segments, samples, 4) penetration and normal force of B and of C.
        predicted: (segments, samples, channels).
        signals: (segments, base samples, SIGNALS) unfiltered.
    """

    chart: Chart
    cost: float
    local: np.ndarray
    residual: np.ndarray
    values: np.ndarray
    used: np.ndarray
    defect: np.ndarray
    contacts: np.ndarray
    predicted: np.ndarray
    signals: np.ndarray

    @property
    def samples(self) -> int:
        """Residuals with weight."""
        return int((self.used > 0.0).sum())

    @property
    def each(self) -> np.ndarray:
        """(segments,) robust cost a sample; infinite where no sample has weight."""
        count = (self.used > 0.0).sum(axis=(1, 2))
        return np.where(count > 0, self.local / np.maximum(count, 1), np.inf)


@dataclass
class Pass(Comparison):
    """One linearisation of a stretch; ``solve`` eliminates its states.

    Attributes:
        system: arguments of ``eliminate``: flow, defect, inputs, own, prior, damping, jacobian,
            sensitivity, residual.
        reach: (nz + inputs,) change of each unknown that the linearisation surely bears.
        scale: factor on the noise.
        gram: (P + 1, P + 1) inner products of what the states cannot explain: parameters, residual.
        parts: (segments, P) shares of the segments in the gram's last column: their scores.
        innovation: (segments, samples, channels) residual against the prediction from earlier segments.
        spread: (segments, samples, channels) its standard deviation; both in those of the noise.
        kept: eliminated rows.
    """

    system: tuple[np.ndarray, ...]
    reach: np.ndarray
    scale: float
    gram: np.ndarray = field(init=False)
    parts: np.ndarray = field(init=False)
    innovation: np.ndarray = field(init=False)
    spread: np.ndarray = field(init=False)
    kept: np.ndarray = field(init=False)

    def solve(self, damping: float | np.ndarray = 0.0, judged: bool = True) -> "Pass":
        """Eliminate the states.

        Args:
            damping: weight that holds each where it is (Levenberg), one or one a segment.
            judged: whether innovations are wanted.
        """
        flow, defect, inputs, own, prior, held, jacobian, sensitivity, residual = self.system
        n, rows, parameters = sensitivity.shape
        nv = jacobian.shape[3]
        held = np.maximum(held, np.sqrt(np.broadcast_to(damping, n))[:, None] / self.reach)
        self.kept = np.zeros((n, nv, 3 * nv + parameters + 1))
        self.gram = np.zeros((parameters + 1, parameters + 1))
        self.parts = np.zeros((n, parameters))
        shape = self.residual.shape if judged else (0, *self.residual.shape[1:])
        innovation, spread = np.zeros((shape[0], rows)), np.ones((shape[0], rows))
        eliminate(
            flow, defect, inputs, own, prior, held, jacobian, sensitivity, residual, self.kept, self.gram,
            self.parts, innovation, spread,
        )  # fmt: skip
        self.innovation, self.spread = innovation.reshape(shape), spread.reshape(shape)
        return self

    def beside(self, seen: Comparison, inputs: np.ndarray) -> "Pass":
        """The same derivatives beside another motion near by: to go on without computing them again.

        Reference: chord method, Kelley 1995, Iterative Methods for Linear and Nonlinear Equations, ch. 5.4.

        Args:
            seen: the motion, of the same stretch.
            inputs: (segments, inputs) unknown forces on it, in their standard deviations.
        """
        flow, _, before, own, prior, held, jacobian, sensitivity, residual = self.system
        shape = residual.shape
        again = np.divide(seen.used, self.used, out=np.zeros_like(seen.used), where=self.used > 0.0)
        rows = again.reshape(shape)[:, :, None]
        weight = continuity(seen.defect)
        kept = (weight / continuity(self.defect))[:, :, None]
        flow, own, jacobian = flow * kept, own.copy(), jacobian.copy()
        own[1:] *= kept[:-1]
        jacobian[:, 1] *= rows
        jacobian[:-1, 2] *= rows[1:]
        jacobian[1:, 0] *= rows[:-1]
        system = (
            flow, seen.defect * weight, inputs[:, : before.shape[1]], own, prior, held, jacobian,
            sensitivity * rows, (seen.residual / self.scale * seen.used).reshape(shape),
        )  # fmt: skip
        about = {one.name: getattr(seen, one.name) for one in fields(Comparison)}
        return Pass(**about, system=system, reach=self.reach, scale=self.scale)

    def draw(self, random: np.random.Generator) -> np.ndarray:
        """(segments, nz + inputs) deviation from the solution, drawn from what is known of the states."""
        return draw(self.kept, random)

    def change(self, parameters: np.ndarray) -> np.ndarray:
        """(segments, nz + inputs) solution for a change of the parameters."""
        solution = np.zeros(self.kept.shape[:2])
        substitute(self.kept, parameters, solution)
        return solution


def continuity(defect: np.ndarray) -> np.ndarray:
    """Weights of rows of continuity: far from its place a segment's end weighs less."""
    return np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(defect), OUTLIER)))
