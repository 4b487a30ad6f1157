"""A film that steps cannot follow is refused: it would make numbers that mean nothing."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.film import SqueezeFilm
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.sensors import SensorChain
from clearance.recording.synthesis import Campaign, ClearanceLocation
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal
from clearance.simulation.stability import require_stable, stiffest_film
from clearance.simulation.trajectory import simulate_trajectory

MACHINE = SliderCrank()
IN_C = ClearanceLocation("C", b=False, c=True)


def campaign(machine, **more):
    return Campaign(machine, IN_C, Integrator(), MeasurementChain(), SensorChain(), runs=1, **more)


def filmed(damping, joint="c"):
    return replace(MACHINE, **{f"joint_{joint}": Joint(3e-4, film=SqueezeFilm(damping))})


def test_the_limit_follows_from_masses_and_step():
    """A uniform rod is accelerated across by 4/m at its end, along by 1/m, the slider along its guide."""
    uniform = replace(
        MACHINE, rod=replace(MACHINE.rod, inertia=MACHINE.rod.mass * MACHINE.rod.length**2 / 12.0)
    )
    mobility = 1.0 / uniform.rod.mass + max(3.0 / uniform.rod.mass, 1.0 / uniform.slider.mass)
    assert stiffest_film(uniform, "C", 1e-5) == pytest.approx(1.5e5 * (1.0 - 0.99**2) ** 1.5 / mobility)
    assert stiffest_film(uniform, "C", 1e-6) == pytest.approx(10.0 * stiffest_film(uniform, "C", 1e-5))
    assert stiffest_film(uniform, "B", 1e-5) < stiffest_film(uniform, "C", 1e-5)  # the crank is light


@pytest.mark.parametrize("scheme", ["semi_implicit_euler", "runge_kutta_4"])
def test_up_to_the_limit_steps_follow_a_film_as_shorter_ones_do(scheme):
    machine = replace(filmed(stiffest_film(MACHINE, "C", 1e-5)), drive=SpeedControl(700.0))
    spread = []
    for step in (1e-5, 2e-6):
        run = simulate_trajectory(machine, Integrator(scheme, step), 0.05, every=round(1e-4 / step))
        spread.append(run.signals[:, Signal.SLIDER_HORIZONTAL].std())
    assert spread[0] == pytest.approx(spread[1], rel=0.05)
    assert np.isfinite(spread).all()


@pytest.mark.parametrize("joint", ["b", "c"])
def test_a_stiffer_film_is_refused_with_what_would_do(joint):
    most = stiffest_film(MACHINE, joint.upper(), 1e-5)
    require_stable(filmed(0.99 * most, joint), 1e-5)
    with pytest.raises(InputError, match=rf"joint_{joint}\.film\.damping = .*up to {most:.3g} N s/m; lower"):
        require_stable(filmed(1.01 * most, joint), 1e-5)
    with pytest.raises(InputError, match=r"lower film\.damping or integrator.step"):
        campaign(filmed(2.0 * most, joint))
    ideal = replace(MACHINE, **{f"joint_{joint}": Joint(film=SqueezeFilm(2.0 * most))})
    require_stable(ideal, 1e-5)  # a joint without clearance has no film
    with pytest.raises(InputError, match=rf"joint_{joint}\.film\.damping") if joint == "c" else nullcontext():
        campaign(ideal)  # in C clearance is drawn
    with pytest.raises(InputError, match=r"lower film\.damping or integrator.step"):
        campaign(filmed(0.0, joint), random={f"joint_{joint}.film.damping": [0, 3 * most]})
