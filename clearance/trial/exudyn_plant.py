"""A second plant, on Exudyn: the mechanism in a general multibody code, with a rod that may truly bend.

Neither the engine nor ``clearance.trial.plant`` wrote its equations: planar rigid bodies, constraints at A
and B, a sphere in a hollow sphere at C, and, if wanted, a rod of beam elements in absolute nodal coordinates.
Needs ``pip install '.[exudyn]'``.

Reference: Gerstmayr 2023, Exudyn - a C++-based Python package for flexible multibody systems, Multibody Syst.
Dyn. 60, 533-561; the beam: Gerstmayr and Irschik 2008, On the correct representation of bending and axial
deformation in the absolute nodal coordinate formulation with an elastic line approach, J. Sound Vib. 318,
461-487; the scheme: Chung and Hulbert 1993, A time integration algorithm for structural dynamics with
improved numerical dissipation, J. Appl. Mech. 60, 371-375.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import pairwise
from math import asin, cos, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from clearance.errors import InputError
from clearance.trial.exudyn_motion import ExudynRun, Motion, run_of
from clearance.trial.plant import BASE_RATE, FloatArray, Plant
from clearance.trial.plant.kernels import APPROACH_FLOOR

FLYWHEEL_INERTIA = 1e3  # kg m²: a drive torque of 10 N m changes its speed by 0.01 rad/s in a second
# m/s, twenty times that of steel: the rod is some 700 times as stiff along its axis as the contact (100 N at
# c = 0.1 mm), so that bending is all that it adds
AXIAL_WAVE_SPEED = 1e5
# of the fastest motion from step to step: else constrained bodies alternate, which folds into the signals
SPECTRAL_RADIUS = 0.7


class _Rod(NamedTuple):
    """Where the rest of the model attaches to a rod.

    Attributes:
        nodes: along a flexible rod from B to C, or the one of a rigid rod.
        at_b: marker of the end at B.
        at_c: marker of the journal.
    """

    nodes: Sequence[int]
    at_b: int
    at_c: int


@dataclass(frozen=True, kw_only=True)
class ExudynPlant:
    """The nominal machine (docs/mechanism.md) with clearance in C, turning at its speed at the start.

    Attributes:
        clearance: radial, of joint C [m].
        speed_rpm: reference speed [rpm].
        rod_frequency: of the first bending mode of the rod with both ends pinned [Hz]; ``None``: it is rigid.
        damping_ratio: of that mode; the damping is proportional to the stiffness [-].
        elements: along the rod. A flexible rod is uniform: its inertia m l²/12 is 0.8 % above a rigid one's.
        step: of the integration [s]; 1e-5 must be a multiple of it.
        start_angle: of the crank [rad]; rod and slider start as in the ideal mechanism.
    """

    clearance: float = 3e-4
    speed_rpm: float = 700.0
    rod_frequency: float | None = None
    damping_ratio: float = 0.02
    elements: int = 6
    step: float = 2e-6
    start_angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("clearance", "rod_frequency", "elements", "step"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"ExudynPlant.{name} = {value} must be positive")

    def run(self, duration: float) -> ExudynRun:
        """Simulate from time 0.

        Raises:
            InputError: if Exudyn is not installed.
            FloatingPointError: if the solver does not converge.
        """
        return Model(self).run(duration)


class Model:
    """One Exudyn system: parts are added, then it is solved once."""

    def __init__(self, plant: ExudynPlant) -> None:
        self.plant, self.nominal = plant, Plant(joint="C", clearance=plant.clearance)
        self.exudyn, self.items = load_exudyn()
        self.container = self.exudyn.SystemContainer()  # owns the system
        self.system = self.container.AddSystem()
        self.omega = plant.speed_rpm * pi / 30.0
        self.length = self.nominal.rod[2]

    def add(self, kind: str, **parameters: Any) -> int:
        """Add an item by its name in Exudyn, such as ``NodePoint2D``; returns its number."""
        item = getattr(self.items, kind)(**parameters)
        category = next(name for name in ("Node", "Object", "Marker", "Sensor") if kind.startswith(name))
        return int(getattr(self.system, f"Add{category}")(item))

    def run(self, duration: float) -> ExudynRun:
        """See ``ExudynPlant.run``."""
        every = round(1.0 / (BASE_RATE * self.plant.step))
        if every < 1 or abs(every * self.plant.step * BASE_RATE - 1.0) > 1e-9:
            raise ValueError(f"ExudynPlant.step = {self.plant.step:g} s must divide {1.0 / BASE_RATE:g} s")
        theta, crank_length = self.plant.start_angle, self.nominal.crank[2]
        phi = asin(-crank_length * sin(theta) / self.length)
        spin = -crank_length * cos(theta) * self.omega / (self.length * cos(phi))
        b, b_rate = crank_length * _unit(theta), crank_length * self.omega * _turned(theta)
        c, c_rate = b + self.length * _unit(phi), b_rate + self.length * spin * _turned(phi)

        crank, crank_body = self.body(self.nominal.crank, 0.5 * b, 0.5 * b_rate, theta, self.omega)
        make = self.rigid_rod if self.plant.rod_frequency is None else self.beam
        rod = make(b, b_rate, phi, spin)
        frame, arm = self.add("ObjectGround"), 0.5 * crank_length
        at_a = [self.marker(frame, 0.0), self.marker(crank_body, -arm)]
        for markers in (at_a, [self.marker(crank_body, arm), rod.at_b]):
            self.add("ObjectJointRevolute2D", markerNumbers=markers)
        slider, contact = self.slider(c[0], c_rate[0], rod.at_c)
        flywheel = self.drive(crank)

        nodes = (crank, *rod.nodes, slider, flywheel)
        motions, touch = self.solve(every, round(duration * BASE_RATE), nodes, contact)
        return run_of(self.nominal, motions[0], motions[1:-2], motions[-2], motions[-1], touch)

    def marker(self, body: int, x: float, kind: str = "MarkerBodyPosition") -> int:
        """A marker on a body, by its axial coordinate [m]."""
        return self.add(kind, bodyNumber=body, localPosition=[x, 0.0, 0.0])

    def body(
        self, link: tuple[float, float, float], place: FloatArray, rate: FloatArray, angle: float, spin: float
    ) -> tuple[int, int]:
        """A rigid link by its centre of mass, angle and their rates; its node and body."""
        start = {"referenceCoordinates": [*place, angle], "initialVelocities": [*rate, spin]}
        node = self.add("NodeRigidBody2D", **start)
        return node, self.add("ObjectRigidBody2D", mass=link[0], inertia=link[1], nodeNumber=node)

    def rigid_rod(self, b: FloatArray, b_rate: FloatArray, angle: float, spin: float) -> _Rod:
        """The rigid rod, from B on."""
        arm = 0.5 * self.length
        middle, rate = b + arm * _unit(angle), b_rate + arm * spin * _turned(angle)
        node, body = self.body(self.nominal.rod, middle, rate, angle, spin)
        return _Rod([node], self.marker(body, -arm), self.marker(body, arm, "MarkerBodyRigid"))

    def beam(self, b: FloatArray, b_rate: FloatArray, angle: float, spin: float) -> _Rod:
        """The flexible rod, from B on; straight and turning at the start."""
        omega, density = 2.0 * pi * (self.plant.rod_frequency or 0.0), self.nominal.rod[0] / self.length
        bending, axial = density * (omega * self.length**2 / pi**2) ** 2, density * AXIAL_WAVE_SPEED**2
        delay = 2.0 * self.plant.damping_ratio / omega  # s, damping over stiffness
        piece = self.length / self.plant.elements
        nodes, pieces = [], []
        for x in np.linspace(0.0, self.length, self.plant.elements + 1):
            place = [*(b + x * _unit(angle)), *_unit(angle)]  # and the slope
            rate = [*(b_rate + x * spin * _turned(angle)), *(spin * _turned(angle))]
            nodes.append(self.add("NodePoint2DSlope1", referenceCoordinates=place, initialVelocities=rate))
        for pair in pairwise(nodes):
            stiffness = {"bendingStiffness": bending, "axialStiffness": axial}
            damping = {"bendingDamping": delay * bending, "axialDamping": delay * axial}
            inertia = {"length": piece, "massPerLength": density}
            values = inertia | stiffness | damping
            pieces.append(self.add("ObjectANCFCable2D", nodeNumbers=list(pair), **values))
        journal = self.marker(pieces[-1], piece, "MarkerBodyRigid")  # the contact asks for an orientation
        return _Rod(nodes, self.marker(pieces[0], 0.0), journal)

    def slider(self, place: float, rate: float, journal: int) -> tuple[int, int]:
        """The slider and its contact with the journal; their nodes."""
        clearance, radius = self.plant.clearance, self.nominal.journal_radius
        node = self.add("Node1D", referenceCoordinates=[place], initialVelocities=[rate])
        body = self.add("ObjectMass1D", mass=self.nominal.slider[0], nodeNumber=node)
        # gap, sliding speed, approach speed at first touch, plastic overlap
        apart = [clearance, 0.0, 0.0, 0.0]
        contact = self.add("NodeGenericData", initialCoordinates=apart, numberOfDataCoordinates=4)
        compliance = 2.0 * (1.0 - 0.3**2) / 200e9  # 1/Pa, of two steel surfaces
        hysteresis = 0.75 * (1.0 - self.nominal.restitution**2)  # Lankarani and Nikravesh
        self.add(
            "ObjectContactSphereSphere",
            markerNumbers=[journal, self.marker(body, 0.0, "MarkerBodyRigid")],
            nodeNumber=contact,
            spheresRadii=[radius, radius + clearance],
            isHollowSphere1=True,
            contactStiffness=4.0 / (3.0 * compliance) * sqrt(radius * (radius + clearance) / clearance),
            contactStiffnessExponent=1.5,
            impactModel=1,  # Hunt and Crossley, whose hysteresis factor is 3/2 (1 - restitution)
            restitutionCoefficient=1.0 - hysteresis / 1.5,
            minimumImpactVelocity=APPROACH_FLOOR,
        )
        return node, contact

    def drive(self, crank: int) -> int:
        """A spring and a damper from the crank's angle to a flywheel at the reference speed; its node."""
        node = self.add("Node1D", referenceCoordinates=[0.0], initialVelocities=[self.omega])
        self.add("ObjectRotationalMass1D", inertia=FLYWHEEL_INERTIA, nodeNumber=node)
        markers = [
            self.add("MarkerNodeCoordinate", nodeNumber=number, coordinate=coordinate)
            for number, coordinate in ((crank, 2), (node, 0))
        ]
        gains = {"stiffness": self.nominal.ki, "damping": self.nominal.kp}
        self.add("ObjectConnectorCoordinateSpringDamper", markerNumbers=markers, **gains)
        return node

    def solve(
        self, every: int, samples: int, nodes: Sequence[int], contact: int
    ) -> tuple[list[Motion], FloatArray]:
        """The motion of each node at 100 kHz; the contact's data (samples, 4)."""
        kinds = self.exudyn.OutputVariableType
        orders = (kinds.Coordinates, kinds.Coordinates_t, kinds.Coordinates_tt)

        def sensor(node: int, order: Any) -> int:
            what = {"nodeNumber": node, "outputVariableType": order}
            return self.add("SensorNode", **what, storeInternal=True, writeToFile=False)

        sensors = [[sensor(node, order) for order in orders] for node in nodes]
        touch = sensor(contact, kinds.Coordinates)
        self.system.Assemble()
        try:
            self.system.SolveDynamic(
                self.settings(samples * every),
                solverType=self.exudyn.DynamicSolverType.GeneralizedAlpha,
                showHints=False,
            )
        except ValueError as error:
            raise FloatingPointError(f"Exudyn's solver did not converge: {self.plant}") from error

        def read(number: int) -> FloatArray:
            return np.array(self.system.GetSensorStoredData(number))[:samples, 1:]  # the first column is time

        references = [np.array(self.system.GetNode(node)["referenceCoordinates"]) for node in nodes]
        motions = [
            Motion(reference + read(place), read(rate), read(acceleration))
            for reference, (place, rate, acceleration) in zip(references, sensors, strict=True)
        ]
        return motions, read(touch)

    def settings(self, steps: int) -> Any:
        """One thread, a fixed step, no files, and a Newton iteration as loose as the results allow."""
        settings = self.exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = 1.0 / BASE_RATE
        settings.show.computationTime = settings.show.statistics = False
        settings.parallel.numberOfThreads = 1
        integration = settings.timeIntegration
        integration.numberOfSteps, integration.endTime = steps, steps * self.plant.step
        integration.verboseMode = 0
        integration.generalizedAlpha.spectralRadius = SPECTRAL_RADIUS
        integration.adaptiveStep = integration.automaticStepSize = False
        # else the first touch asks for a shorter step, which a fixed step answers with failure
        integration.discontinuous.useRecommendedStepSize = False
        integration.newton.absoluteTolerance = integration.newton.relativeTolerance = 1e-2
        # an old Jacobian kept through contact nearly doubles the slider's accelerations
        integration.newton.useModifiedNewton = False
        return settings


def _unit(angle: float) -> FloatArray:
    return np.array([cos(angle), sin(angle)])


def _turned(angle: float) -> FloatArray:
    return np.array([-sin(angle), cos(angle)])


def load_exudyn() -> tuple[Any, Any]:
    """Exudyn and its items; its type stubs lack much of what it offers.

    Raises:
        InputError: if it is not installed.
    """
    try:
        return import_module("exudyn"), import_module("exudyn.itemInterface")
    except ImportError as error:
        raise InputError("the second plant needs Exudyn: pip install '.[exudyn]'") from error
