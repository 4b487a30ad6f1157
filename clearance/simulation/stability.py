"""Which laws a step of time can follow: stiffer ones make numbers that mean nothing before they overflow."""

from clearance.errors import InputError
from clearance.mechanism.film import ECCENTRICITY_LIMIT, SqueezeFilm
from clearance.mechanism.parameters import Family
from clearance.mechanism.slider_crank import SliderCrank

_STABLE = 1.5  # step times rate: the explicit schemes are stable up to 2 (Euler) and 2.78 (Runge-Kutta)


def stiffest_film(machine: SliderCrank, joint: str, step: float) -> float:
    """The largest damping of a film, journal centred, that steps follow everywhere in the gap [N s/m].

    A damper d between two bodies decays at the rate d w, w being how fast a unit force accelerates them
    apart, in the direction in which that is most: at C a guided slider gives way along its guide alone.

    Args:
        machine: whose masses count.
        joint: B or C.
        step: of time [s].
    """
    rod, crank = machine.rod, machine.crank
    arm = rod.length * (rod.center_of_mass if joint == "B" else 1.0 - rod.center_of_mass)
    pivot = crank.inertia + crank.mass * (crank.center_of_mass * crank.length) ** 2
    turning = arm**2 / rod.inertia
    if joint == "B":
        mobility = 1.0 / rod.mass + turning + crank.length**2 / pivot
    else:
        gives = 1.0 / machine.slider.mass
        loose = machine.codes()[Family.GUIDE] != 0
        mobility = 1.0 / rod.mass + (turning + gives if loose else max(turning, gives))
    return float(_STABLE * (1.0 - ECCENTRICITY_LIMIT**2) ** 1.5 / (step * mobility))


def too_stiff(machine: SliderCrank, step: float) -> list[str]:
    """Joints, B or C, with clearance and a film that steps of time [s] cannot follow."""
    joints = {"B": machine.joint_b, "C": machine.joint_c}
    return [
        name
        for name, joint in joints.items()
        if joint.clearance > 0.0
        and isinstance(joint.film, SqueezeFilm)
        and joint.film.damping > stiffest_film(machine, name, step)
    ]


def require_stable(machine: SliderCrank, step: float) -> None:
    """Refuse films that steps cannot follow.

    Raises:
        InputError: with the largest damping.
    """
    for joint in too_stiff(machine, step):
        place = f"joint_{joint.lower()}"
        given, most = getattr(machine, place).film.damping, stiffest_film(machine, joint, step)
        raise InputError(
            f"{place}.film.damping = {given:g}: too stiff for steps of {step:g} s, which follow up to "
            f"{most:.3g} N s/m; lower film.damping or integrator.step"
        )
