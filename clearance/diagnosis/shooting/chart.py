"""The unknowns of a node: which coordinates are free, in which directions, and how a change is applied.

A journal that touches its bearing is held radially by 1e8 N/m and not at all along the surface. Its unknowns
are therefore taken along and across its eccentricity, and a change across is a rotation: moving straight
along the tangent by 0.05 mm would press it a micrometre into the bearing.
"""

from dataclasses import dataclass

import numpy as np

from clearance.mechanism.parameters import JOINT_STRIDE, Family, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.layout import COORDINATES, State
from clearance.simulation.shooting import ECCENTRICITY_B, ECCENTRICITY_C

_CENTRE = 0.5  # of the clearance: nearer to the centre a journal has no useful direction
_LARGEST_TURN = 1.0  # rad, of a journal in its bearing in one change

# Units are the size of a typical uncertainty; process noise is what the integrator and rounding leave.
_ANGLE, _SPEED = (1e-6, 1e-8), (1e-3, 1e-4)  # rad, rad/s
_PLACE, _RATE = (1e-8, 2e-9), (1e-4, 1e-4)  # m, m/s
_TILT, _TILT_RATE = (1e-6, 1e-7), (1e-2, 1e-2)
_INTEGRAL = (1e-5, 1e-7)  # rad
_MEMORY = (1e-3, 1e-3)  # m/s
_FLYING = 3000.0  # units by which the rates of a slider that hangs between its rails may be wrong


@dataclass(frozen=True)
class Chart:
    """Free rows of a node for one choice of laws.

    Attributes:
        rows: (nz,) rows of the node.
        units: (nz,) change of each that counts as one.
        noise: (nz,) standard deviation of what a segment's end may miss the next node by.
        journals: for each loose joint the places, among the unknowns, of its two eccentricities; their rates
            follow each.
        rails: height [m] over the guide line and tilt [rad] at which a slider that is loose in its guide
            touches; 0: it is not.
        line: height of the guide line over A, on a frame at rest [m].
    """

    rows: np.ndarray
    units: np.ndarray
    noise: np.ndarray
    journals: tuple[tuple[int, int], ...]
    rails: tuple[float, float] = (0.0, 0.0)
    line: float = 0.0

    @property
    def reach(self) -> np.ndarray:
        """(nz,) by how many units an unknown may change before its linearisation fails."""
        reach = np.full(len(self.rows), 300.0)
        reach[0], reach[1] = 1000.0, 300.0  # 1e-3 rad, 0.3 rad/s
        for i, j in self.journals:
            reach[[i, i + 1]] = 20.0, 100.0  # 0.2 um, 0.01 m/s across the surface
            reach[[j, j + 1]] = 500.0, 500.0  # 5 um, 0.05 m/s along it
        return reach

    @staticmethod
    def of(machine: SliderCrank) -> "Chart":
        """The chart of a machine; units of eccentricities over clearance follow its clearances."""
        codes, p = machine.codes(), machine.parameters()
        table: list[tuple[int, float, float]] = []
        journals: list[tuple[int, int]] = []

        def add(row: int, place: tuple[float, float], rate: tuple[float, float], scale: float = 1.0) -> None:
            table.append((row, place[0] / scale, place[1] / scale))
            table.append((row + COORDINATES, rate[0] / scale, rate[1] / scale))

        add(State.CRANK_ANGLE, _ANGLE, _SPEED)
        for family, pair, block in (
            (Family.JOINT_B, ECCENTRICITY_B, 0),
            (Family.JOINT_C, ECCENTRICITY_C, JOINT_STRIDE),
        ):
            if codes[family]:
                journals.append((len(table), len(table) + 2))
                for row in pair:
                    add(row, _PLACE, _RATE, p[Parameter.JOINT_CLEARANCE + block])
        rails = (0.0, 0.0)
        if codes[Family.GUIDE]:
            gap = float(p[Parameter.GUIDE_GAP])
            rails = (gap, gap / float(p[Parameter.SHOE_HALF_LENGTH]))
            add(State.SLIDER_Y, _PLACE, _RATE)
            add(State.SLIDER_ANGLE, _TILT, _TILT_RATE)
        if codes[Family.FRAME]:
            add(State.FRAME_X, _PLACE, _RATE)
            add(State.FRAME_Y, _PLACE, _RATE)
        if codes[Family.LINK]:
            add(State.ROD_MODE, _PLACE, _RATE)
        if p[Parameter.DRIVE_INTEGRAL_GAIN]:
            table.append((State.DRIVE_INTEGRAL, *_INTEGRAL))
        for family, row in ((Family.JOINT_B, State.MEMORY_B), (Family.JOINT_C, State.MEMORY_C)):
            if codes[family]:
                table.append((row, *_MEMORY))
        columns = np.array(table, dtype=float).T
        return Chart(
            columns[0].astype(np.int64),
            columns[1],
            columns[2],
            tuple(journals),
            rails,
            float(p[Parameter.GUIDE_OFFSET]),
        )

    def bases(self, nodes: np.ndarray) -> np.ndarray:
        """(nodes, nz, nz) change of the rows, in units, by each unknown."""
        bases = np.repeat(np.eye(len(self.rows))[None], len(nodes), axis=0)
        for i, j in self.journals:
            _, distance, normal = self._polar(nodes, i, j)
            x, y = normal.T
            for first, second in ((i, j), (i + 1, j + 1)):
                bases[:, first, first], bases[:, second, first] = x, y
                bases[:, first, second], bases[:, second, second] = -y, x
            rates = nodes[:, [self.rows[i + 1], self.rows[j + 1]]]
            turn = np.where(distance > _CENTRE, 1.0 / distance, 0.0) * self.units[j] / self.units[i + 1]
            bases[:, i + 1, j], bases[:, j + 1, j] = -rates[:, 1] * turn, rates[:, 0] * turn
        return bases

    def moved(self, nodes: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Nodes after a change (nodes, nz) of the unknowns."""
        moved, step = nodes.copy(), change * self.units
        straight = np.ones(len(self.rows), dtype=bool)
        for i, j in self.journals:
            straight[[i, i + 1, j, j + 1]] = False
            place, distance, normal = self._polar(nodes, i, j)
            far = distance > _CENTRE
            x, y = normal.T
            rows = self.rows
            turn = np.where(far, step[:, j] / distance, 0.0).clip(-_LARGEST_TURN, _LARGEST_TURN)
            sine, cosine = np.sin(turn), np.cos(turn)
            across = np.where(far, 0.0, step[:, j])
            px, py = place[:, 0] + step[:, i] * x - across * y, place[:, 1] + step[:, i] * y + across * x
            vx = nodes[:, rows[i + 1]] + step[:, i + 1] * x - step[:, j + 1] * y
            vy = nodes[:, rows[j + 1]] + step[:, i + 1] * y + step[:, j + 1] * x
            moved[:, rows[i]], moved[:, rows[j]] = px * cosine - py * sine, px * sine + py * cosine
            moved[:, rows[i + 1]], moved[:, rows[j + 1]] = vx * cosine - vy * sine, vx * sine + vy * cosine
        moved[:, self.rows[straight]] += step[:, straight]
        memories = [State.MEMORY_B, State.MEMORY_C]
        moved[:, memories] = np.maximum(moved[:, memories], 0.0)
        return moved

    def carried(self, nodes: np.ndarray, before: "Chart") -> np.ndarray:
        """Nodes of a machine with other rails, as near to these rails as they were to its own."""
        carried = nodes.copy()
        if self.rails[0]:
            carried[..., State.SLIDER_Y] += self.line - before.line
        carried[..., [State.SLIDER_Y, State.SLIDER_ANGLE]] += before.between_rails(nodes) * (
            np.array(self.rails) - before.rails
        )
        return carried

    def between_rails(self, nodes: np.ndarray) -> np.ndarray:
        """(..., 2) height and tilt of nodes (..., STATES), each over that at which it touches; 0 without."""
        if not self.rails[0]:
            return np.zeros((*nodes.shape[:-1], 2))
        height = nodes[..., State.SLIDER_Y] - nodes[..., State.FRAME_Y] - self.line
        return np.stack([height, nodes[..., State.SLIDER_ANGLE]], axis=-1) / self.rails

    def pressed(self, nodes: np.ndarray) -> np.ndarray:
        """(...) how far a slider is on its way from the middle to its rails; above 1 it presses."""
        pressed: np.ndarray = np.abs(self.between_rails(nodes)).sum(axis=-1)
        return pressed

    def doubt(self, node: np.ndarray) -> np.ndarray:
        """(nz,) by how many units a guessed node may be wrong."""
        doubt = np.full(len(self.rows), 1000.0)
        for place, row in enumerate(self.rows):
            doubt[place] = {
                State.CRANK_ANGLE: 1e4,
                State.DRIVE_INTEGRAL: 1500.0,
                State.SLIDER_Y: max(self.rails[0] / _PLACE[0], 1.0),
                State.SLIDER_ANGLE: max(self.rails[1] / _TILT[0], 1.0),
                State.SLIDER_Y_RATE: _FLYING,
                State.SLIDER_SPEED: _FLYING,
                State.MEMORY_B: 100.0,
                State.MEMORY_C: 100.0,
            }.get(State(int(row)), 1000.0)
        for i, j in self.journals:
            touches = np.hypot(node[self.rows[i]], node[self.rows[j]]) > 1.0
            doubt[[i, i + 1]] = (20.0, 20.0) if touches else (1000.0, 500.0)
            doubt[[j, j + 1]] = 3000.0, 500.0
        return doubt

    def _polar(self, nodes: np.ndarray, i: int, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        place = nodes[:, [self.rows[i], self.rows[j]]]
        distance = np.maximum(np.hypot(place[:, 0], place[:, 1]), 1e-12)
        normal = place / distance[:, None]
        normal[distance <= _CENTRE] = (1.0, 0.0)
        return place, distance, normal
