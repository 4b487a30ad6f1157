"""Our time step beside Exudyn's: the same mechanism, one core each, in turns."""

from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from clearance.benchmark.campaigns import last_sample, simulate_all
from clearance.benchmark.exudyn_model import FORMULATIONS, SAMPLING_PERIOD, simulate_with_exudyn
from clearance.benchmark.measurement import Cost, measure
from clearance.lanes import WIDTH
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.synthesis import Campaign
from clearance.simulation.layout import Signal
from clearance.simulation.trajectory import simulate_trajectory

SPREAD = 1e-4
"""Relative difference of clearance between neighbouring runs: enough for each to go its own way."""


def _neighbours(machine: SliderCrank, count: int) -> list[SliderCrank]:
    joint = machine.joint_c
    return [
        replace(machine, joint_c=replace(joint, clearance=joint.clearance * (1.0 + SPREAD * i)))
        for i in range(count)
    ]


def compare(
    campaign: Campaign, clearances: list[float], speed_rpm: float, duration: float, repeats: int
) -> list[dict[str, Any]]:
    """Cost of both codes at the first clearance; their slider accelerations at all of them.

    Args:
        campaign: what gives mechanism, step and base rate.
        clearances: of joint C [m].
        speed_rpm: of the crank [rpm].
        duration: simulated time [s]; the statistics are those of its second half.
        repeats: of which the median counts.

    Returns:
        One entry a code and formulation, ours first.
    """
    nominal = replace(campaign.mechanism, drive=campaign.mechanism.drive.at_speed(speed_rpm))
    machines = {c: replace(nominal, joint_c=replace(nominal.joint_c, clearance=c)) for c in clearances}
    step, steps = campaign.integrator.step, round(duration / campaign.integrator.step)
    crowd = _neighbours(machines[clearances[0]], 2 * WIDTH)
    sampling = last_sample(campaign.chain.base_rate, duration)
    costs: dict[str, list[Cost]] = {name: [] for name in ("clearance", *FORMULATIONS)}
    for _ in tqdm(range(repeats), unit="turn", desc="beside Exudyn"):
        ours = partial(simulate_all, crowd, campaign.integrator, sampling, 1)
        costs["clearance"].append(measure(ours)[0])
        for name, formulation in FORMULATIONS.items():
            costs[name].append(
                simulate_with_exudyn(machines[clearances[0]], formulation, step, duration).cost
            )
    titles = {"clearance": f"clearance, {WIDTH} runs in lockstep"}
    titles |= {name: f"Exudyn, {formulation.title}" for name, formulation in FORMULATIONS.items()}
    entries = []
    for name, spent in costs.items():
        done = steps * (len(crowd) if name == "clearance" else 1)
        typical = sorted(spent, key=lambda cost: cost.cpu_s)[len(spent) // 2]
        spread = {
            f"{c:g}": _our_deviations(machines[c], campaign, duration)
            if name == "clearance"
            else [_exudyn_deviation(machines[c], name, step, duration)]
            for c in clearances
        }
        entries.append(
            {
                "name": name,
                "code": titles[name],
                **asdict(typical),
                "steps": done,
                "steps_per_second_per_core": done / typical.cpu_s,
                "slider_acceleration_deviation": spread,
            }
        )
    for entry in entries:
        entry["ratio"] = entries[0]["steps_per_second_per_core"] / entry["steps_per_second_per_core"]
    return entries


def _our_deviations(machine: SliderCrank, campaign: Campaign, duration: float) -> list[float]:
    """Standard deviation of the slider's acceleration in eight runs that hardly differ [m/s^2]."""
    every = round(SAMPLING_PERIOD / campaign.integrator.step)
    found = []
    for neighbour in _neighbours(machine, 8):
        trajectory = simulate_trajectory(neighbour, campaign.integrator, duration, every)
        late = trajectory.time >= 0.5 * duration
        found.append(float(np.std(trajectory.signals[late, Signal.SLIDER_HORIZONTAL])))
    return found


def _exudyn_deviation(machine: SliderCrank, name: str, step: float, duration: float) -> float:
    run = simulate_with_exudyn(machine, FORMULATIONS[name], step, duration)
    return float(np.std(run.acceleration[run.time >= 0.5 * duration]))
