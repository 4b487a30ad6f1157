"""When a force begins or ends with a jump, so that no step of the integration goes across one."""

from typing import Any

from clearance.compilation import kernel
from clearance.lanes import maximum, minimum, square_root, where, zero


@kernel
def until_reached(distance: Any, beyond: float, rate: Any, acceleration: Any, most: Any) -> Any:
    """Time [s] until a distance is covered, and a little more; at most ``most``, which is short.

    Args:
        distance: still to go; nothing is reached from beyond, where it is negative [m].
        beyond: by how much to go beyond it, so that a step that begins there begins on the other side [m].
        rate: at which it is covered [m/s].
        acceleration: likewise, constant [m/s^2].
        most: [s].
    """
    far = distance + beyond
    speed2 = rate * rate + 2.0 * acceleration * far
    speed = rate + square_root(maximum(speed2, 0.0))
    reached = (distance > 0.0) & (speed2 >= 0.0) & (speed > 0.0)
    time = 2.0 * far / where(reached, speed, zero(speed) + 1.0)
    return where(reached, minimum(time, most), most)
