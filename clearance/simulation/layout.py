"""The fixed layout of the state and of what one evaluation of the equations leaves behind.

One layout serves every law: frame 2, crank 1, rod 3, slider 3, first rod mode 1, the drive's integral, and
one contact memory a joint. A coordinate that no law frees is constrained: it follows from the others and
costs nothing.
"""

from enum import IntEnum, auto

COORDINATES = 10


class State(IntEnum):
    """Rows of the state: ten coordinates, their ten rates, and memories. SI units, inertial axes."""

    FRAME_X = 0
    FRAME_Y = auto()
    CRANK_ANGLE = auto()
    ROD_X = auto()  # centre of mass
    ROD_Y = auto()
    ROD_ANGLE = auto()
    SLIDER_X = auto()
    SLIDER_Y = auto()
    SLIDER_ANGLE = auto()
    ROD_MODE = auto()
    FRAME_X_RATE = auto()
    FRAME_Y_RATE = auto()
    CRANK_SPEED = auto()
    ROD_X_RATE = auto()
    ROD_Y_RATE = auto()
    ROD_SPEED = auto()
    SLIDER_X_RATE = auto()
    SLIDER_Y_RATE = auto()
    SLIDER_SPEED = auto()
    ROD_MODE_RATE = auto()
    DRIVE_INTEGRAL = auto()  # rad
    MEMORY_B = auto()  # m/s, approach speed at first touch; 0 while apart
    MEMORY_C = auto()
    TIME = auto()  # s
    # kept beside the angles, so that each sine is computed once a step
    CRANK_SINE = auto()
    CRANK_COSINE = auto()
    ROD_SINE = auto()
    ROD_COSINE = auto()


class Result(IntEnum):
    """Rows of an evaluation: ten accelerations in the order of the coordinates, then forces and gaps."""

    FRAME_X = 0
    FRAME_Y = auto()
    CRANK = auto()
    ROD_X = auto()
    ROD_Y = auto()
    ROD = auto()
    SLIDER_X = auto()
    SLIDER_Y = auto()
    SLIDER = auto()
    ROD_MODE = auto()
    SPEED_ERROR = auto()  # rad/s, rate of the drive's integral
    DRIVE_TORQUE = auto()  # N m
    PENETRATION_B = auto()  # m, negative while apart
    PENETRATION_RATE_B = auto()  # m/s
    NORMAL_FORCE_B = auto()  # N
    MEMORY_B = auto()  # m/s, the contact memory that holds from now on
    PENETRATION_C = auto()
    PENETRATION_RATE_C = auto()
    NORMAL_FORCE_C = auto()
    MEMORY_C = auto()
    FORCE_B_X = auto()  # N, on the crank
    FORCE_B_Y = auto()
    FORCE_C_X = auto()  # N, on the rod
    FORCE_C_Y = auto()
    GUIDE_REACTION = auto()  # N, on the slider across the guide
    GUIDE_FRICTION = auto()  # N, on the slider along the guide
    LOAD = auto()  # N, on the slider along the guide: spring and process


STATES = len(State)
RESULTS = len(Result)

ACCELERATIONS = 10
"""Number of acceleration channels, in the order of the paper's Table 3."""


class Signal(IntEnum):
    """Rows of what ideal sensors show at one instant: ten accelerations, then the other channels."""

    CRANK_A_TRANSVERSE = 0
    CRANK_A_AXIAL = auto()
    CRANK_B_TRANSVERSE = auto()
    CRANK_B_AXIAL = auto()
    ROD_B_TRANSVERSE = auto()
    ROD_B_AXIAL = auto()
    ROD_C_TRANSVERSE = auto()
    ROD_C_AXIAL = auto()
    SLIDER_VERTICAL = auto()
    SLIDER_HORIZONTAL = auto()
    CRANK_ANGLE = auto()
    CRANK_SPEED = auto()
    DRIVE_TORQUE = auto()
    SLIDER_POSITION = auto()
    SLIDER_VELOCITY = auto()


SIGNALS = len(Signal)
