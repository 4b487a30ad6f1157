"""Keep the simulator on a recording: Gauss-Newton over the nodes of short segments.

Method: weak-constraint smoothing by multiple shooting (Bock & Plitt 1984, IFAC Proc. 17(2); Tremolet 2006,
Q. J. R. Meteorol. Soc. 132). Every segment starts at a node of its own, ends where the next node should be,
and predicts the filtered samples around it. Nodes, unknown forces and parameters are found together, so that
no run is longer than a segment and chaos never gets the time to spoil the comparison.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import NO_FAULT, REACH, SAMPLES, Measured
from clearance.diagnosis.shooting.chart import Chart
from clearance.diagnosis.shooting.filtering import pass_filter
from clearance.diagnosis.shooting.stretch import INPUTS, OUTLIER, Comparison, Pass, Path, continuity
from clearance.errors import InputError
from clearance.mechanism.applied_force import CONSTANTS
from clearance.mechanism.parameters import JOINT_STRIDE, PARAMETERS, STRUCTURE, Family, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import aligned
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import SIGNALS, STATES
from clearance.simulation.shooting import WORK_ROWS, coast, shoot

EDGE = 2  # segments at a stretch's ends whose samples feel too much of what lies outside
_GRIP = 1e-3  # weight of continuity there at the beginning: a first bounce, hardly seen, must not hold all up

_FAST = 1e4  # weight that holds a node where it is
_TOGETHER = 31  # derivatives that are taken at a time: two full groups of lanes with the run itself

TIGHT = np.array([1e-3, 1e-3, 1e-2])  # N m, N m, N: unknown forces that a right model does not need


@dataclass
class Follower:
    """The simulator beside one recording.

    Attributes:
        measured: the recording.
        integrator: how the segments are run.
        input_sigma: (inputs,) standard deviation of the unknown forces, constant over a segment.
        nudge: share of these by which derivatives are taken: near a path small ones are right, far from it
            large ones lead further.
        path: present nodes and inputs.
        signals: (segments, periods, signals) the motion as last computed; NaN where it has not been yet.
        wide: (periods, filtered samples) what a segment's motion leaves in the samples around it.
        narrow: (filtered samples, periods) the same in the samples of itself and its two neighbours.
        periods: of the chain's base rate in a segment.
    """

    measured: Measured
    integrator: Integrator
    input_sigma: np.ndarray
    nudge: float = 1.0
    path: Path = field(init=False)
    signals: np.ndarray = field(init=False)
    wide: np.ndarray = field(init=False)
    narrow: np.ndarray = field(init=False)
    periods: int = field(init=False)

    def __post_init__(self) -> None:
        segments = len(self.measured.values)
        self.path = Path.empty(segments)
        self.wide = np.ascontiguousarray(self.measured.weights.T)
        self.narrow = self.measured.weights[(REACH - 1) * SAMPLES : (REACH + 2) * SAMPLES].copy()
        self.periods = self.measured.weights.shape[1]
        # the motion as last computed: what lies outside a stretch still enters its filtered samples
        self.signals = np.full((segments, self.periods, SIGNALS), np.nan)

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.measured.values)

    @property
    def forced(self) -> bool:
        """Whether unknown forces may be large enough to be found together with the path."""
        return bool((self.input_sigma > TIGHT).any())

    def part(self, first: int, last: int) -> "Follower":
        """A follower of segments ``first`` to ``last`` alone, with its own copy of their path."""
        small = Follower(self.measured.part(first, last), self.integrator, self.input_sigma, self.nudge)
        small.path = Path(self.path.nodes[first:last].copy(), self.path.inputs[first:last].copy())
        return small

    def compare(
        self,
        machine: SliderCrank,
        instrument: Instrument = NO_FAULT,
        first: int = 0,
        last: int | None = None,
        scale: float = 1.0,
        looseness: float = 1.0,
        doubt: float = 1.0,
        inside: bool = False,
    ) -> Comparison:
        """Set segments ``first`` to ``last`` of the present path beside the recording, without derivatives.

        Args:
            machine: the model.
            instrument: faults of the instruments.
            first: first segment.
            last: one beyond the last segment; all if ``None``.
            scale: factor on the noise, above 1 while far from a solution.
            looseness: factor on the process noise.
            doubt: factor on how far the first node may be wrong; below 1 the path before is known.
            inside: whether the path is known on both sides: the last node then stays where it is.
        """
        last = self.segments if last is None else last
        ends, contacts = self._coast(machine, first, last)
        grip = _grip(last - first, doubt)
        return self._compared(
            Chart.of(machine), instrument, first, last, ends, contacts, scale, looseness, grip, inside
        )

    def look(
        self,
        machine: SliderCrank,
        columns: Sequence[SliderCrank | None] = (),
        instrument: Instrument = NO_FAULT,
        faults: Sequence[Instrument | None] = (),
        first: int = 0,
        last: int | None = None,
        scale: float = 1.0,
        looseness: float = 1.0,
        doubt: float = 1.0,
        inside: bool = False,
        forces: bool = True,
    ) -> Pass:
        """Linearise segments ``first`` to ``last`` about the present path.

        Args:
            machine: the model.
            columns: the model with one parameter changed each; ``None``: it is no parameter of the machine.
            instrument: faults of the instruments.
            faults: for each column the instruments with the parameter changed; ``None``: none of theirs.
            first: as in ``compare``, like the following.
            last: one beyond the last segment.
            scale: factor on the noise.
            looseness: factor on the process noise.
            doubt: as in ``compare``.
            inside: whether the path is known on both sides.
            forces: whether the unknown forces are among the unknowns.
        """
        last = self.segments if last is None else last
        chart = Chart.of(machine)
        nz, nw, parameters = len(chart.rows), len(INPUTS) if forces else 0, len(columns)
        nv, n = nz + nw, last - first
        channels = len(self.measured.signals)
        flow = np.zeros((n, nz, nv + parameters))
        jacobian = np.zeros((n, 3, SAMPLES, channels, nv))
        shared = np.zeros((n, 3, SAMPLES, channels, parameters))
        ends, contacts = self._differentiate(machine, columns, chart, first, last, flow, jacobian, shared)
        _silence(flow, shared, nv)
        grip = _grip(n, doubt)
        seen = self._compared(chart, instrument, first, last, ends, contacts, scale, looseness, grip, inside)
        noise = chart.noise * looseness * scale
        flow *= (grip[:, None] / noise)[:, :, None]
        bases = chart.bases(self.path.nodes[first:last])
        flow[:, :, :nz] = flow[:, :, :nz] @ bases
        jacobian[..., :nz] = jacobian[..., :nz] @ bases[:, None, None]
        own = (chart.units / noise)[None, :, None] * bases
        own[1:] *= grip[:-1, None, None]
        changed = {i: fault for i, fault in enumerate(faults) if fault is not None}
        if changed:
            # a fault changes what is predicted: undoing it on the noise as well would reward a smaller noise
            clean = self.measured.less(first, seen.values - seen.predicted, instrument)
            for i, moved in zip(changed, clean.moved(instrument, changed.values()), strict=True):
                shared[:, 1, :, :, i] -= moved[first:last]
        weight = 1.0 / (self.measured.restored(instrument)[1] * scale)
        jacobian *= weight[:, None]
        shared *= weight[:, None]
        used = seen.used
        jacobian[:, 1] *= used[..., None]
        jacobian[:-1, 2] *= used[1:, ..., None]
        jacobian[1:, 0] *= used[:-1, ..., None]
        rows = SAMPLES * channels
        blocks = jacobian.reshape(n, 3, rows, nv)
        direct = shared[:, 1]
        direct[1:] += shared[:-1, 2]
        direct[:-1] += shared[1:, 0]
        direct *= used[..., None]
        # a robust row of continuity: both sides weigh less
        kink = continuity(seen.defect)
        flow *= kink[:, :, None]
        own[1:] *= kink[:-1, :, None]
        held = np.zeros((n, nv))
        if inside:
            held[-1] = _FAST
        system = (
            flow, seen.defect * kink, (self.path.inputs[first:last] / self.input_sigma)[:, :nw], own,
            chart.doubt(self.path.nodes[first]) * doubt, held, blocks,
            np.ascontiguousarray(direct.reshape(n, rows, parameters)),
            (seen.residual / scale * used).reshape(n, rows),
        )  # fmt: skip
        reach = np.concatenate([chart.reach, np.full(nw, np.inf)])
        about = {one.name: getattr(seen, one.name) for one in fields(Comparison)}
        return Pass(**about, system=system, reach=reach, scale=scale)

    def beside(self, one: Pass, seen: Comparison, first: int = 0) -> Pass:
        """A linearisation from segment ``first`` on, carried over to the present path as seen."""
        return one.beside(seen, self.path.inputs[first : first + len(seen.local)] / self.input_sigma)

    def _compared(
        self,
        chart: Chart,
        instrument: Instrument,
        first: int,
        last: int,
        ends: np.ndarray,
        contacts: np.ndarray,
        scale: float,
        looseness: float,
        grip: np.ndarray,
        inside: bool,
    ) -> Comparison:
        """What the motion just computed, which ends at ``ends``, leaves unexplained."""
        values, sigma, known = self.measured.restored(instrument)
        predicted = self._predict(first, last)
        residual = (values[first:last] - predicted) / (sigma * scale)
        used = known[first:last].astype(float)
        edge = 1 if inside else EDGE
        used[:edge] = 0.0
        used[-edge:] = 0.0
        size = np.abs(residual)
        used *= np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(size, OUTLIER)))
        defect = np.zeros((last - first, len(chart.rows)))
        noise = chart.noise * looseness * scale
        defect[:-1] = (ends[:-1] - self.path.nodes[first + 1 : last])[:, chart.rows] / noise
        defect *= grip[:, None]
        local = (_huber(size) * (used > 0.0)).sum(axis=(1, 2)) + _huber(np.abs(defect)).sum(axis=1)
        local += ((self.path.inputs[first:last] / self.input_sigma) ** 2).sum(axis=1)
        local[~np.isfinite(local)] = np.inf
        return Comparison(
            chart, float(local.sum()), local, residual * scale, values[first:last], used, defect, contacts,
            predicted, self.signals[first:last],
        )  # fmt: skip

    def arrival(self, machine: SliderCrank, place: int) -> np.ndarray:
        """(STATES,) where a machine is at the end of a segment that begins at its node."""
        return self._coast(machine, place, place + 1)[0][0]

    def arrivals(self, machine: SliderCrank, place: int, nodes: np.ndarray) -> np.ndarray:
        """(nodes, STATES) where a machine is at the end of a segment that begins at one of these nodes."""
        inputs = np.repeat(self.path.inputs[place][None], len(nodes), axis=0)
        signals = np.zeros((len(nodes), self.periods, SIGNALS))
        return self._run(machine, nodes, inputs, signals)[0]

    def move(self, change: np.ndarray, chart: Chart, first: int = 0) -> None:
        """Apply a change (segments, nz + inputs) of the unknowns, or of the nodes alone."""
        nz = len(chart.rows)
        part = slice(first, first + len(change))
        self.path.nodes[part] = chart.moved(self.path.nodes[part], change[:, :nz])
        if change.shape[1] > nz:
            self.path.inputs[part] += change[:, nz:] * self.input_sigma

    def _differentiate(
        self,
        machine: SliderCrank,
        columns: Sequence[SliderCrank | None],
        chart: Chart,
        first: int,
        last: int,
        flow: np.ndarray,
        jacobian: np.ndarray,
        shared: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Fill the derivatives, some of them at a time; flow in SI units."""
        nv, filtered = jacobian.shape[4], self.measured.filtered
        tasks = [*range(nv), *(nv + i for i, column in enumerate(columns) if column is not None)]
        nominal = None
        for begin in range(0, max(len(tasks), 1), _TOGETHER):
            group = tasks[begin : begin + _TOGETHER]
            ends, contacts, blocks, samples = self._shoot(machine, columns, group, nv, first, last, chart)
            if nominal is None:
                nominal = ends[:, 0].copy(), contacts
            shape = (len(ends), 3, SAMPLES, filtered, 1 + len(group))
            changed, of_parameters = blocks.reshape(shape), np.array(group, dtype=int) >= nv
            for target, chosen, least in (jacobian, ~of_parameters, 0), (shared, of_parameters, nv):
                places = np.array(group, dtype=int)[chosen] - least
                lanes = 1 + np.flatnonzero(chosen)
                target[:, :, :, :filtered, places] = changed[..., lanes] - changed[..., :1]
                target[:, 1][:, :, filtered:, places] = samples[..., lanes] - samples[..., :1]
            flow[:, :, group] = (ends[:, 1:] - ends[:, :1])[:, :, chart.rows].swapaxes(1, 2)
        nz = len(chart.rows)
        flow[:, :, nz:nv] /= self.nudge
        jacobian[..., nz:nv] /= self.nudge
        assert nominal is not None
        return nominal

    def _shoot(
        self,
        machine: SliderCrank,
        columns: Sequence[SliderCrank | None],
        tasks: Sequence[int],
        free: int,
        first: int,
        last: int,
        chart: Chart,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        nz, runs = len(chart.rows), 1 + len(tasks)
        varying = {task: column for task in tasks if task >= free and (column := columns[task - free])}
        codes, p = _joint_codes([machine, *varying.values()]), np.empty((PARAMETERS, runs))
        p[:] = machine.parameters()[:, None]
        varied, change = np.full(runs, -1), np.zeros(runs)
        rows = np.array(INPUTS, dtype=np.int64)
        for run, task in enumerate(tasks, 1):
            if task < nz:
                varied[run], change[run] = chart.rows[task], chart.units[task]
            elif task < free:
                p[rows[task - nz], run] += self.nudge * self.input_sigma[task - nz]
            else:
                p[:, run] = varying[task].parameters()
        for row in _SMOOTHING:  # of a law that is switched on for another run
            p[row] = np.where(p[row] > 0.0, p[row], 1e-3)
        measured, n = self.measured, last - first
        filtered = np.array(measured.signals[: measured.filtered], dtype=np.int64)
        points = np.array(measured.signals[measured.filtered :], dtype=np.int64)
        ends = np.empty((n, runs, STATES))
        contacts = np.empty((n, SAMPLES, 4))
        blocks = np.empty((n, 3 * SAMPLES, len(filtered), runs))
        samples = np.empty((n, SAMPLES, len(points), runs))
        period = 1.0 / measured.chain.base_rate
        substeps = self.integrator.substeps(period)
        shoot(
            codes, p, self.path.nodes[first:last], varied, change, rows, self.path.inputs[first:last],
            self.integrator.code, period / substeps, substeps, self.integrator.contact_refinement,
            self.periods, filtered, points, self.narrow, aligned(WORK_ROWS), ends,
            self.signals[first:last], contacts, blocks, samples,
        )  # fmt: skip
        return ends, contacts, blocks, samples

    def _coast(self, machine: SliderCrank, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Ends (segments, STATES) and contacts (segments, samples, 4) of the present path's segments."""
        return self._run(
            machine, self.path.nodes[first:last], self.path.inputs[first:last], self.signals[first:last]
        )

    def _run(
        self, machine: SliderCrank, nodes: np.ndarray, inputs: np.ndarray, signals: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Ends and contacts of segments from these nodes; fills their ``signals``."""
        ends, contacts = np.empty((len(nodes), STATES)), np.empty((len(nodes), SAMPLES, 4))
        period = 1.0 / self.measured.chain.base_rate
        substeps = self.integrator.substeps(period)
        coast(
            _joint_codes([machine]), machine.parameters(), nodes, np.array(INPUTS, dtype=np.int64), inputs,
            self.integrator.code,
            period / substeps, substeps, self.integrator.contact_refinement, self.periods // SAMPLES,
            aligned(WORK_ROWS), ends, signals, contacts,
        )  # fmt: skip
        return ends, contacts

    def _predict(self, first: int, last: int) -> np.ndarray:
        """Filtered prediction from the motion of the stretch and of what is known beside it."""
        rows, filtered = list(self.measured.signals), self.measured.filtered
        points = self.signals[first:last, :: self.periods // SAMPLES][:, :, rows[filtered:]]
        passed = np.zeros((filtered, (last - first) * SAMPLES))
        pass_filter(
            self.signals, np.array(rows[:filtered], dtype=np.int64), self.wide, SAMPLES, first, last, passed
        )
        inside = passed.reshape(filtered, last - first, SAMPLES).transpose(1, 2, 0)
        return np.concatenate([inside, points], axis=2)


def _grip(segments: int, doubt: float) -> np.ndarray:
    """(segments,) weight of each segment's continuity with the next one."""
    grip = np.ones(segments)
    if doubt >= 1.0:
        grip[:EDGE] = _GRIP
    return grip


def _silence(flow: np.ndarray, shared: np.ndarray, known: int) -> None:
    """Drop parameters with which the machine does not run: they say nothing."""
    broken = ~np.isfinite(flow[:, :, known:]).all(axis=(0, 1)) | ~np.isfinite(shared).all(axis=(0, 1, 2, 3))
    flow[:, :, known:][:, :, broken] = 0.0
    shared[..., broken] = 0.0


_SMOOTHING = (
    Parameter.JOINT_FRICTION_SPEED,
    Parameter.JOINT_FRICTION_SPEED + JOINT_STRIDE,
    Parameter.GUIDE_FRICTION_SPEED,
)  # fmt: skip


def alike(one: SliderCrank, other: SliderCrank) -> bool:
    """Whether two machines have the same coordinates."""
    return bool((one.codes()[STRUCTURE] == other.codes()[STRUCTURE]).all())


def _joint_codes(machines: Sequence[SliderCrank]) -> np.ndarray:
    """Laws that any of the machines has: where a machine lacks one, its parameters are zero."""
    each = np.array([machine.codes() for machine in machines])
    if (each[:, STRUCTURE] != each[0, STRUCTURE]).any():
        raise InputError(
            "a parameter has left the range in which its effect adds coordinates to the mechanism"
        )
    codes = each.max(axis=0)
    if not codes[Family.FORCE]:
        codes[Family.FORCE] = CONSTANTS
    return codes


def _huber(size: np.ndarray) -> np.ndarray:
    return np.where(size <= OUTLIER, size**2, 2.0 * OUTLIER * size - OUTLIER**2)
