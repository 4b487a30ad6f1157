"""The nominal mechanism in Exudyn, a general multibody code, with clearance in joint C.

The same bodies, stiffness, hysteresis and drive as ``SliderCrank``, and no Python function called in the run:

- the contact is Exudyn's sphere in a hollow sphere with its Hunt-Crossley law, whose restitution is set so
  that its hysteresis factor 3/2 (1 - e) equals that of our law;
- a proportional-integral law on the speed is a spring and a damper on the angle, here between the crank and
  a flywheel so heavy that its speed is the reference speed.

Reference: Gerstmayr 2023, Exudyn - a C++-based Python package for flexible multibody systems, Multibody Syst.
Dyn. 60, 533-561.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from clearance.benchmark.measurement import Cost, measure
from clearance.mechanism.contact import APPROACH_FLOOR
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.slider_crank import SliderCrank

exudyn: Any = import_module("exudyn")  # its type stubs lack much of what it offers
items: Any = import_module("exudyn.itemInterface")

FLYWHEEL_INERTIA = 1e3  # kg m^2: a drive torque of 10 N m changes its speed by 0.01 rad/s in a second
SAMPLING_PERIOD = 1e-4  # s, of the slider's acceleration


@dataclass(frozen=True)
class _Markers:
    """Where the common parts attach: the crank's angle and the journal at the rod's end."""

    crank_angle: int
    journal: int


def _planar_bodies(system: Any, machine: SliderCrank) -> _Markers:
    """Two rigid bodies with three coordinates each, revolute joints at A and B as constraints."""
    ends = [system.AddMarker(items.MarkerBodyPosition(bodyNumber=system.AddObject(items.ObjectGround())))]
    nodes, start, body = [], 0.0, -1
    for link in (machine.crank, machine.rod):
        arm = link.center_of_mass * link.length
        nodes.append(system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[start + arm, 0.0, 0.0])))
        body = system.AddObject(
            items.ObjectRigidBody2D(mass=link.mass, inertia=link.inertia, nodeNumber=nodes[-1])
        )
        ends += [
            system.AddMarker(items.MarkerBodyPosition(bodyNumber=body, localPosition=[x, 0.0, 0.0]))
            for x in (-arm, link.length - arm)
        ]
        start += link.length
    system.AddObject(items.ObjectJointRevolute2D(markerNumbers=ends[0:2]))
    system.AddObject(items.ObjectJointRevolute2D(markerNumbers=ends[2:4]))
    tip = [(1.0 - machine.rod.center_of_mass) * machine.rod.length, 0.0, 0.0]
    return _Markers(
        system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=2)),
        system.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=tip)),
    )


def _joint_angles(system: Any, machine: SliderCrank) -> _Markers:
    """A kinematic tree with two coordinates, the angles at A and B; explicit solvers need no constraints."""
    links = (machine.crank, machine.rod)
    node = system.AddNode(
        items.NodeGenericODE2(
            referenceCoordinates=[0.0, 0.0],
            initialCoordinates=[0.0, 0.0],
            initialCoordinates_t=[0.0, 0.0],
            numberOfODE2Coordinates=2,
        )
    )
    tree = system.AddObject(
        items.ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=[exudyn.JointType.RevoluteZ] * 2,
            linkParents=[-1, 0],
            jointTransformations=exudyn.Matrix3DList([np.eye(3)] * 2),
            jointOffsets=exudyn.Vector3DList([[0.0, 0.0, 0.0], [machine.crank.length, 0.0, 0.0]]),
            linkInertiasCOM=exudyn.Matrix3DList([np.diag([0.0, 0.0, link.inertia]) for link in links]),
            linkCOMs=exudyn.Vector3DList([[link.center_of_mass * link.length, 0.0, 0.0] for link in links]),
            linkMasses=[link.mass for link in links],
        )
    )
    tip = [machine.rod.length, 0.0, 0.0]
    return _Markers(
        system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0)),
        system.AddMarker(items.MarkerKinematicTreeRigid(objectNumber=tree, linkNumber=1, localPosition=tip)),
    )


@dataclass(frozen=True)
class Formulation:
    """One way to pose and solve the mechanism in Exudyn.

    Attributes:
        title: for people.
        bodies: adds crank and rod.
        solver: a name of ``exudyn.DynamicSolverType``.
    """

    title: str
    bodies: Callable[[Any, SliderCrank], _Markers]
    solver: str


FORMULATIONS = {
    "implicit": Formulation("planar bodies, trapezoidal rule", _planar_bodies, "TrapezoidalIndex2"),
    "explicit": Formulation("joint angles, explicit midpoint", _joint_angles, "ExplicitMidpoint"),
    "fastest": Formulation("joint angles, velocity Verlet", _joint_angles, "VelocityVerlet"),
}
"""The usual way; the fastest one that is accurate at h = 1e-5 s; the fastest one that runs at all."""


@dataclass(frozen=True)
class ExudynRun:
    """What one run cost and gave.

    Attributes:
        cost: of the solver alone.
        time: (samples,) [s].
        acceleration: (samples,) of the slider [m/s^2].
    """

    cost: Cost
    time: np.ndarray
    acceleration: np.ndarray


def simulate_with_exudyn(
    machine: SliderCrank, formulation: Formulation, step: float, duration: float
) -> ExudynRun:
    """Simulate from rest.

    Args:
        machine: nominal laws with clearance in C alone.
        formulation: see ``FORMULATIONS``.
        step: [s].
        duration: longer than the drive's ramp [s].
    """
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    markers = formulation.bodies(system, machine)
    slider = _add_slider(system, machine, markers.journal)
    load = _add_drive(system, machine, markers.crank_angle)
    sensor = system.AddSensor(
        items.SensorNode(
            nodeNumber=slider,
            outputVariableType=exudyn.OutputVariableType.Coordinates_tt,
            storeInternal=True,
            writeToFile=False,
        )
    )
    system.Assemble()
    settings = _settings()
    solver = getattr(exudyn.DynamicSolverType, formulation.solver)
    drive = _speed_control(machine)
    wall = cpu = 0.0
    samples = []
    for begin, end in ((0.0, drive.ramp), (drive.ramp, duration)):
        settings.timeIntegration.startTime, settings.timeIntegration.endTime = begin, end
        settings.timeIntegration.numberOfSteps = round((end - begin) / step)
        cost, _ = measure(
            partial(
                system.SolveDynamic, settings, solverType=solver, updateInitialValues=True, showHints=False
            )
        )
        wall, cpu = wall + cost.wall_s, cpu + cost.cpu_s
        samples.append(np.array(system.GetSensorStoredData(sensor)))
        system.SetLoadParameter(load, "load", 0.0)  # the reference speed is reached
    recorded = np.concatenate(samples)
    _, first = np.unique(recorded[:, 0], return_index=True)  # each phase stores its first sample too
    recorded = recorded[first]
    return ExudynRun(Cost(wall, cpu), recorded[:, 0], recorded[:, 1])


def _speed_control(machine: SliderCrank) -> SpeedControl:
    if not isinstance(machine.drive, SpeedControl):
        raise TypeError(f"the Exudyn model has a speed-controlled drive, not {type(machine.drive).__name__}")
    return machine.drive


def _add_slider(system: Any, machine: SliderCrank, journal: int) -> int:
    """The slider and its contact with the journal; returns the slider's node."""
    joint = machine.joint_c
    rest = [machine.crank.length + machine.rod.length, 0.0, 0.0]
    node = system.AddNode(
        items.Node1D(referenceCoordinates=[0.0], initialCoordinates=[0.0], initialVelocities=[0.0])
    )
    body = system.AddObject(
        items.ObjectMass1D(mass=machine.slider.mass, nodeNumber=node, referencePosition=rest)
    )
    bearing = system.AddMarker(items.MarkerBodyRigid(bodyNumber=body))
    memory = system.AddNode(
        items.NodeGenericData(initialCoordinates=[joint.clearance, 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
    )
    system.AddObject(
        items.ObjectContactSphereSphere(
            markerNumbers=[journal, bearing],
            nodeNumber=memory,
            spheresRadii=[joint.journal_radius, joint.journal_radius + joint.clearance],
            isHollowSphere1=True,
            contactStiffness=joint.contact.stiffness(joint.journal_radius, joint.clearance),
            contactStiffnessExponent=1.5,
            impactModel=1,
            restitutionCoefficient=1.0 - joint.contact.hysteresis / 1.5,
            minimumImpactVelocity=APPROACH_FLOOR,
        )
    )
    return node


def _add_drive(system: Any, machine: SliderCrank, crank_angle: int) -> int:
    """The flywheel that turns at the reference speed; returns the load that spins it up."""
    drive = _speed_control(machine)
    node = system.AddNode(
        items.Node1D(referenceCoordinates=[0.0], initialCoordinates=[0.0], initialVelocities=[0.0])
    )
    system.AddObject(items.ObjectRotationalMass1D(inertia=FLYWHEEL_INERTIA, nodeNumber=node))
    reference = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
    system.AddObject(
        items.ObjectConnectorCoordinateSpringDamper(
            markerNumbers=[crank_angle, reference], stiffness=drive.integral, damping=drive.proportional
        )
    )
    torque = FLYWHEEL_INERTIA * drive.speed_rpm * np.pi / 30.0 / drive.ramp
    return int(system.AddLoad(items.LoadCoordinate(markerNumber=reference, load=torque)))


def _settings() -> Any:
    """One thread, a fixed step, no files, and a Newton iteration as loose as the results allow."""
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = SAMPLING_PERIOD
    settings.show.computationTime = settings.show.statistics = False
    settings.parallel.numberOfThreads = 1
    integration = settings.timeIntegration
    integration.verboseMode = 0
    integration.adaptiveStep = integration.automaticStepSize = False
    # else the first touch asks for a shorter step, which a fixed step answers with failure
    integration.discontinuous.useRecommendedStepSize = False
    integration.newton.absoluteTolerance = integration.newton.relativeTolerance = 1e-2
    # measured: keeping an old Jacobian through contact nearly doubles the slider's accelerations
    integration.newton.useModifiedNewton = False
    return settings
