"""Diagnoses as the page may get them, with evidence of realistic shape: made in code, of no machine."""

import numpy as np

CHANNELS = (
    "crank_b_transverse",
    "crank_b_axial",
    "rod_b_transverse",
    "rod_b_axial",
    "rod_c_transverse",
    "rod_c_axial",
    "slider_vertical",
    "slider_horizontal",
)
CRANK, ROD = 0.05, 0.12
WEIGHTS = {"slider_horizontal": 1.0, "rod_c_transverse": 0.45, "rod_c_axial": 0.3, "rod_b_axial": 0.16}


def physics():
    """Friction in the guide and a slightly wrong rod: everything that the page can show."""
    rng = np.random.default_rng(1)
    diagnosis = {
        "verdict": "physics",
        "summary": [
            "The slider feels 5.1 N (4.8–5.4) of Coulomb friction that the model lacks.",
            "It shows in slider_horizontal and rod_c_transverse, mostly where the slider reverses.",
            "With it, held-out error falls from 8.1 to 1.04 (floor 1.00) and the clearance from 0.311 to "
            "0.300 mm.",
        ],
        "warnings": ["run_3.parquet: crank_a_axial is zero throughout; it was left out."],
        "recordings": [
            {
                "name": f"run_{index}.parquet",
                "seconds": 2.0,
                "rate_hz": 10000.0,
                "channels": list(CHANNELS),
                "speed_rpm": 612.4 + 97.3 * index,
                "held_out_seconds": 2.0 if index == 3 else 0.0,
            }
            for index in range(4)
        ],
        "mismatch": {
            "detected": True,
            "p_value": 0.0005,
            "body": "slider",
            "direction": "x",
            "regime": "sliding",
            "channels": {"slider_horizontal": 0.61, "rod_c_transverse": 0.2, "rod_c_axial": 0.12},
            "crank_angle_deg": [[165, 205], [345, 375]],
            "frequency_hz": [[0, 300]],
        },
        "effects": [
            {
                "name": "guide_friction",
                "kind": "physics",
                "probability": 0.97,
                "parameters": {
                    "coulomb_force": {"value": 5.1, "unit": "N", "low": 4.8, "high": 5.4},
                    "viscous_damping": {"value": 0.61, "unit": "N s/m", "low": 0.35, "high": 0.88},
                },
            },
            {
                "name": "rod_inertia",
                "kind": "physics",
                "probability": 0.88,
                "parameters": {
                    "mass_ratio": {"value": 1.053, "unit": "1", "low": 1.041, "high": 1.066, "off": 1.0}
                },
            },
        ],
        "equivalent": [["guide_friction", "rod_inertia"], ["joint_lubrication", "rod_inertia"]],
        "next_experiment": "2 further recordings at 931 rpm would tell these explanations apart.",
        "experiments": [
            {"recordings": 2, "speed_rpm": 931.0, "channel": None, "other_speed": True},
            {"recordings": 5, "speed_rpm": 700.0, "channel": "slider_vertical", "other_speed": False},
            {"recordings": 28, "speed_rpm": 700.0, "channel": None, "other_speed": False},
        ],
        "free_form": None,
        "fit": {
            "metric": "root mean square of the innovations over their expected size",
            "held_out": {"before": 8.1, "after": 1.04, "floor": 1.0, "low": 0.98, "high": 1.1},
        },
        "clearance": {
            "joint": "C",
            "before_m": 3.11e-4,
            "after_m": 3.001e-4,
            "low_m": 2.99e-4,
            "high_m": 3.01e-4,
        },
        "seconds": 118.0,
    }
    evidence = {
        "where": _where(rng, after=True),
        "missing_force": _missing_force(rng),
        "ranking": _ranking(),
        **_comparison(rng, recordings=2),
        "detectability": _detectability(),
        "checks": _checks(rng),
        "clearance_profile": {
            "clearance_m": np.linspace(0.297e-3, 0.303e-3, 41),
            "misfit": 1.02 + 0.4 * ((np.linspace(0.297, 0.303, 41) - 0.3001) / 1e-3) ** 2,
        },
    }
    return diagnosis, evidence


def nothing_missing():
    """The model is right: short, and with parts missing or empty."""
    rng = np.random.default_rng(2)
    diagnosis = {
        "verdict": "none",
        "summary": [
            "Nothing is missing: the model explains both recordings to within their noise.",
            "A friction in the guide above 0.4 N, or a rod 0.8 % heavier, would have been seen.",
        ],
        "warnings": [],
        "recordings": [
            {
                "name": "a.parquet",
                "seconds": 1.0,
                "rate_hz": 10000,
                "channels": list(CHANNELS[2:6]),
                "speed_rpm": 702.0,
                "held_out_seconds": 0.33,
            },
            {"name": "b.parquet", "seconds": 1.0, "rate_hz": 10000, "channels": list(CHANNELS[2:6])},
        ],
        "mismatch": {"detected": False, "p_value": 0.43, "channels": {}, "crank_angle_deg": []},
        "effects": [],
        "equivalent": [],
        "next_experiment": None,
        "fit": {"metric": None, "held_out": {"before": 1.01, "after": None, "floor": 1.0}},
        "clearance": {
            "joint": "C",
            "before_m": 6.0e-4,
            "after_m": 6.002e-4,
            "low_m": 5.98e-4,
            "high_m": 6.02e-4,
        },
        "seconds": 21.4,
    }
    evidence = {
        "where": {
            **_where(rng, after=False, strength=0.0, channels=CHANNELS[2:6]),
            "significant": [],
        },
        "checks": _checks(rng, CHANNELS[2:6]),
        "detectability": _detectability(),
    }
    return diagnosis, evidence


def unknown():
    """A force that no named effect describes: free-form curve, ranking without an assertion."""
    rng = np.random.default_rng(3)
    position = np.linspace(0.07, 0.17, 60)
    force = -6.0 * np.exp(-(((position - 0.13) / 0.012) ** 2)) + 1.5 * (position - 0.12) / 0.05
    diagnosis = {
        "verdict": "unknown",
        "summary": [
            "Something pushes the slider back by up to 6 N near the middle of its stroke, and no known "
            "effect explains it.",
            "A free-form force over the slider's position takes the held-out error from 3.9 to 1.12.",
        ],
        "recordings": [
            {
                "name": "rig.csv",
                "seconds": 3.0,
                "rate_hz": 5000,
                "channels": list(CHANNELS[2:]),
                "speed_rpm": [548.0, 561.0],
                "held_out_seconds": 1.0,
            }
        ],
        "mismatch": {
            "detected": True,
            "p_value": 0.001,
            "body": "slider",
            "direction": "x",
            "regime": "all",
            "channels": {"slider_horizontal": 0.7, "rod_c_axial": 0.24},
            "crank_angle_deg": [[62, 118], [242, 298]],
            "frequency_hz": [[0, 180]],
        },
        "effects": [],
        "equivalent": [],
        "next_experiment": "Turn the crank slowly by hand with a force gauge on the slider: a force of "
        "position alone stays.",
        "free_form": {
            "body": "slider",
            "direction": "x",
            "argument": "slider_position",
            "table": [[float(x), float(y)] for x, y in zip(position[::6], force[::6], strict=True)],
        },
        "fit": {
            "metric": "rms innovation / expected",
            "held_out": {"before": 3.9, "after": 1.12, "floor": 1.0, "low": 1.05, "high": 1.2},
        },
        "clearance": {
            "joint": "C",
            "before_m": 2.2e-4,
            "after_m": 2.004e-4,
            "low_m": 1.93e-4,
            "high_m": 2.08e-4,
        },
        "seconds": 96.0,
    }
    evidence = {
        "where": _where(rng, after=True, strength=0.4, peaks=(90, 270)),
        "missing_force": _missing_force(rng),
        "free_form": {
            **diagnosis["free_form"],
            "unit": "N",
            "argument_unit": "m",
            "low": force[::6] - 0.5,
            "high": force[::6] + 0.5,
        },
        "ranking": [dict(entry, asserted=False) for entry in _ranking()[:5]],
        **_comparison(rng),
    }
    return diagnosis, evidence


def instrument():
    """A sensor on the rod with a wrong gain."""
    rng = np.random.default_rng(4)
    diagnosis, evidence = nothing_missing()
    diagnosis.update(
        verdict="instrument",
        summary=["The sensor of rod_c_transverse shows another size than it should: 1.052 times the truth."],
        mismatch={
            "detected": True, "p_value": 0.002, "body": "instrument", "direction": "along", "regime": "all",
            "channels": {"rod_c_transverse": 0.7, "rod_b_axial": 0.2}, "crank_angle_deg": [],
            "frequency_hz": [],
        },
        effects=[
            {
                "name": "sensor_gain", "kind": "instrument", "channel": "rod_c_transverse",
                "probability": 0.99,
                "parameters": {
                    "gain": {"value": 1.052, "unit": "-", "low": 1.049, "high": 1.055, "off": 1.0}
                },
            }
        ],
    )  # fmt: skip
    evidence["where"] = _where(rng, after=True, strength=0.3, channels=CHANNELS[2:6])
    return diagnosis, evidence


EXAMPLES = {"physics": physics, "none": nothing_missing, "unknown": unknown, "instrument": instrument}


def _where(rng, after, strength=1.0, peaks=(185, 360), channels=CHANNELS):
    angles = np.arange(5.0, 360, 10)
    heat = 1 + 0.05 * rng.normal(size=(len(channels), angles.size))
    corrected = 1 + 0.06 * rng.normal(size=heat.shape)
    for row, name in enumerate(channels):
        for peak in peaks:
            off = (angles - peak + 180) % 360 - 180
            heat[row] += 11 * strength * WEIGHTS.get(name, 0.04) * np.exp(-((off / 16) ** 2))
        heat[row] += 1.2 * strength * WEIGHTS.get(name, 0)
    frequency = np.arange(25.0, 5000, 50)
    falling = 1 / (1 + (frequency / 350) ** 2)
    found = {
        "channels": list(channels),
        "crank_angle_deg": angles,
        "heat": heat,
        "significant": heat > 1.6,
        "regimes": {
            name: {
                "contact": 1 + 1.8 * strength * WEIGHTS.get(name, 0.03),
                "flight": 1 + 0.9 * strength * WEIGHTS.get(name, 0.01),
                "sliding": 1 + 5 * strength * WEIGHTS.get(name, 0.02),
            }
            for name in channels
        },
        "frequency_hz": frequency,
        "spectrum": {
            name: 1
            + 9 * strength * WEIGHTS.get(name, 0.02) * falling
            + 0.04 * rng.normal(size=frequency.size)
            for name in channels
        },
    }
    return {**found, "heat_after": corrected} if after else found


def _missing_force(rng):
    """Of two recordings, on the slider and on the crank."""
    time = np.arange(0, 0.4, 1e-3)
    angle, position, velocity, _ = _motion(time, 2 * np.pi * 11.8)
    known = {
        "time_s": time,
        "crank_angle_deg": np.rad2deg(angle) % 360.0,
        "slider_position_m": position,
        "slider_velocity_m_s": velocity,
    }
    friction = -5.1 * np.tanh(3 * velocity) - 0.6 * velocity + 0.25 * rng.normal(size=time.size)
    ripple = 0.02 * rng.normal(size=time.size)
    return [
        {"recording": "a", "body": "slider", "direction": "x", "unit": "N", **known,
         "value": friction, "low": friction - 0.6, "high": friction + 0.6},
        {"recording": "a", "body": "crank", "direction": "torque", "unit": "N m", **known,
         "value": ripple, "low": ripple - 0.05, "high": ripple + 0.05},
    ]  # fmt: skip


def _ranking():
    def parameter(value, unit, half, **more):
        return {"value": value, "unit": unit, "low": value - half, "high": value + half, **more}

    tried = [
        ("guide_friction", "guide", 84800.0, 0.0005, True, "beats the free-form force", {
            "coulomb_force": parameter(5.1, "N", 0.3), "viscous_damping": parameter(0.61, "N s/m", 0.26)}),
        ("rod_inertia", "link", 1210.0, 0.0005, True, "with guide_friction", {
            "mass_ratio": parameter(1.053, "1", 0.012, off=1.0)}),
        ("joint_lubrication", "joint", 1190.0, 0.002, False, "cannot be told from rod_inertia", {
            "damping": parameter(41.0, "N s/m", 12.0)}),
        ("process_load", "load", 640.0, 0.03, False, "worse than the free-form force", {
            "force": parameter(3.0, "N", 2.2)}),
        ("slider_spring", "load", 210.0, 0.11, False, "", {"stiffness": parameter(28.0, "N/m", 40.0)}),
        ("torque_ripple", "drive", 92.0, 0.21, False, "interval contains off", {}),
        ("sensor_gain", "instrument", 61.0, 0.24, False, "", {
            "slider_horizontal": parameter(1.004, "1", 0.006, off=1.0)}),
        ("flexible_base", "frame", 33.0, 0.4, False, "", {}),
        ("gravity", "load", 12.0, 0.55, False, "", {}),
        ("joint_friction", "joint", 3.0, 0.8, False, "", {}),
        ("timebase", "instrument", 0.4, 0.95, False, "", {}),
    ]  # fmt: skip
    keys = ("name", "kind", "log_likelihood_gain", "p_value", "asserted", "note", "parameters")
    return [dict(zip(keys, entry, strict=True)) for entry in tried]


def _motion(time, speed):
    """Crank angle, and position, velocity and acceleration of the slider."""
    angle = speed * time
    rod = np.arcsin(-CRANK * np.sin(angle) / ROD)
    slider = CRANK * np.cos(angle) + ROD * np.cos(rod)
    velocity = np.gradient(slider, time)
    return angle, slider, velocity, np.gradient(velocity, time)


def _comparison(rng, recordings=1):
    time = np.arange(0, 0.25, 1e-4)
    angle, _, _, slider = _motion(time, 2 * np.pi * 11.8)
    overlays = []
    for name in CHANNELS[3::2]:
        size = 0.4 + WEIGHTS.get(name, 0.15)
        smooth = size * slider
        kicks, after_kicks = np.zeros_like(time), np.zeros_like(time)
        for start in np.arange(0.004, 0.25, 0.0137):
            on = time > start
            ring = np.exp(-(time - start) * 900) * np.sin(2 * np.pi * 1400 * (time - start)) * on
            kicks += 160 * size * ring
            shifted = np.exp(-(time - start - 8e-4) * 900) * np.sin(2 * np.pi * 1400 * (time - start - 8e-4))
            after_kicks += 190 * size * shifted * (time > start + 8e-4)
        friction = -36 * size * np.tanh(8 * np.sin(angle))
        recorded = smooth + kicks + friction + 4 * rng.normal(size=time.size)
        signals = {"recorded": recorded, "before": smooth + after_kicks, "after": smooth + friction + kicks}
        overlays.append({"channel": name, "unit": "m/s^2", "time_s": time, **signals})
    return {
        "overlays": overlays,
        "signatures": {"recordings": [_signature(rng, f"run_{k}", 1.0 + 0.3 * k) for k in range(recordings)]},
    }


def _signature(rng, name, faster):
    """Phase averages, spectra and impacts of one recording and of both models."""
    degrees, frequency = np.arange(1.0, 360, 2), np.geomspace(10, 5000, 110)
    turn = np.deg2rad(degrees)
    phase, spectrum = [], []
    for channel in CHANNELS:
        size = 0.4 + WEIGHTS.get(channel, 0.15)
        mean, step = (
            300 * size * np.cos(turn) + 90 * size * np.cos(2 * turn),
            36 * size * np.tanh(8 * np.sin(turn)),
        )
        spread = 25 * size * (1.0 + np.sin(turn) ** 2)
        courses = {
            "recorded": mean - step + 6 * rng.normal(size=turn.size),
            "before": mean,
            "after": mean - step,
        }
        phase.append({
            "channel": channel, "unit": "m/s^2",
            **{kind: {"mean": course, "spread": spread} for kind, course in courses.items()},
            "distance": {"before": 2.0 + 8.0 * size, "after": 0.8 + 0.2 * rng.random()},
        })  # fmt: skip
        level = size * (
            900 / (1 + (frequency / 30) ** 2) + 8 * np.exp(-(((frequency - 1400) / 400) ** 2)) + 0.2
        )
        low = 1 + 1.5 / (1 + (frequency / 300) ** 2)
        recorded = level * np.exp(0.12 * rng.normal(size=frequency.size))
        lines = {"recorded": recorded, "before": level * low, "after": level}
        spectrum.append({"channel": channel, "unit": "m/s^2/√Hz", **lines})
    return {
        "name": name, "revolutions": 7.9, "crank_angle_deg": degrees, "phase": phase,
        "frequency_hz": frequency, "spectrum": spectrum,
        "impacts": {
            "channel": "slider_horizontal", "unit": "m/s^2", "threshold": 11.7,
            "recorded": {"per_revolution": 6.4, "low": 5.1, "high": 7.7, "median_strength": 212.0},
            "before": {"per_revolution": 9.1 * faster, "low": 8.2, "high": 12.9, "median_strength": 318.0},
            "after": {"per_revolution": 6.5, "low": 5.9, "high": 7.1, "median_strength": 209.0},
        },
    }  # fmt: skip


def _detectability():
    clearances, speeds = [1e-4, 3e-4, 8e-4], [500.0, 600.0, 700.0, 800.0]
    grid = np.outer([1.0, 1.6, 2.3], [1.0, 1.2, 1.3, 1.7])
    rows = [
        ("guide_friction", "coulomb_force", "N", 4e-3),
        ("rod_inertia", "mass_ratio", "-", 2.6e-4),
        ("joint_lubrication", "damping", "N s/m", 2.4e-5),
        ("restitution", "restitution", "-", None),
    ]
    effects = [
        {"name": name, "parameter": parameter, "unit": unit, "size": {
            sensors: [[None if size is None else size * worse * value for value in line] for line in grid]
            for sensors, worse in (("all", 1.0), ("rod", 2.5))
        }}
        for name, parameter, unit, size in rows
    ]  # fmt: skip
    effects[3]["size"]["all"][2][1] = 0.04
    effects.append({
        "name": "rod_flexibility", "parameter": "frequency", "unit": "Hz", "of": "structure", "seen": "below",
        "weakest": 19200.0, "shape": [{"name": "damping_ratio", "value": 0.01, "unit": "-"}],
        "size": {"all": (3000.0 * grid).tolist(), "rod": (2000.0 * grid).tolist()},
    })  # fmt: skip
    effects[4]["size"]["all"][0][0] = 19200.0
    return {
        "joint": "C", "noise": 0.01, "seconds": 1.0, "clearance_m": clearances, "speed_rpm": speeds,
        "sensor_sets": {"all": list(CHANNELS), "rod": list(CHANNELS[2:6])}, "effects": effects,
        "here": {
            "clearance_m": 3.1e-4, "speed_rpm": 690.0, "sensors": "all",
            "effects": [
                {"name": name, "parameter": parameter, "unit": unit, "size": size and 0.8 * size}
                for name, parameter, unit, size in rows
            ],
        },
    }  # fmt: skip


def _checks(rng, channels=CHANNELS):
    return {
        "channels": list(channels),
        "whiteness": 0.04 * rng.normal(size=len(channels)),
        "normalised_innovation_squared": {"value": 1.012, "low": 0.971, "high": 1.03},
        "autocorrelation": {name: 0.03 * rng.normal(size=10) for name in channels},
    }
