"""A diagnosis in plain words: the headline first, then where it shows and how much better the fit is."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.free_form import DAMPING, unnamed
from clearance.diagnosis.judging.verdict import (
    argument_of,
    clearance_of,
    cushioned,
    estimates,
    nearer,
    place_of,
    rivals,
    unconfirmed,
)
from clearance.diagnosis.searching.explanation import Explanation
from clearance.mechanism.applied_force import TabulatedForce

_PUSHES = {"torque": "torque", "moment": "moment"}
_HELPS = 0.99  # of the held-out error before: what leaves more is not said to lower it


def sentences(
    verdict: str,
    explanation: Explanation,
    joint: str,
    fit: dict[str, Any],
    channels: Sequence[str],
    held_out: Attempt | None = None,
) -> list[str]:
    """The diagnosis in plain words, the headline first; ``held_out`` as of ``verdict_of``."""
    best, nominal = explanation.best, explanation.nominal
    before, after = nominal.fit.values[0, 0] * 1e3, clearance_of(explanation).value * 1e3
    held = fit["held_out"]
    if verdict == "none":
        return [
            f"Nothing is missing that these recordings could show: the clearance of joint {joint} is "
            f"{after:.4f} mm, and one-step errors are those of the noise ({held['after']:.2f}, floor 1.00)."
        ]
    gain = f"With it, held-out error falls from {held['before']:.3g} to {held['after']:.3g} (floor 1.00)"
    if not held["after"] < _HELPS * held["before"]:
        gain = (
            f"It does not help on held-out recordings, where errors are {held['after']:.3g} with it and "
            f"{held['before']:.3g} without (floor 1.00)"
        )
    if "followed" in held:
        gain = (
            f"Where held-out recordings could be followed, errors are {held['followed']:.3g} with it (floor "
            "1.00); elsewhere its path was lost,"
        )
    if "lost" in held:
        gain = (
            "Every fitted recording is followed with it, and the motion shows that play as well; what was "
            f"held out was lost at the slider's strikes (errors {held['after']:.3g}, floor 1.00),"
        )
    missed = unconfirmed(explanation, held_out)
    if missed:
        return [
            f"The fitted recordings show nothing missing: the clearance of joint {joint} is {after:.4f} mm. "
            f"But the path through what was held out of {' and '.join(missed)} was lost, so that it cannot "
            "be said that nothing is."
        ]
    seen = f" in {', '.join(channels)}" if channels else ""
    if verdict == "unknown" and not best.hypotheses:
        body, direction = place_of(explanation, held_out)
        guess = f" What comes nearest acts on the {body.replace('_', ' ')} ({direction})." if body else ""
        return [
            "Something is missing that none of the tried hypotheses explains: the nominal model's errors are "
            f"{held['before']:.3g} times those of a perfect one.",
            f"{f'It shows most{seen}.' if seen else 'No channel shows it alone.'}{guess}",
            *_gap(explanation),
        ]
    lines = []
    place = 1
    values = estimates(best)
    curve = unnamed(best.hypotheses)
    if curve is not None:
        law = curve.apply(nominal.model.machine(nominal.fit.values[0]), curve.start).force
        argument = argument_of(law) if isinstance(law, TabulatedForce) else ""
        share = "" if explained(best) else "most of "
        where = curve.body.replace("_", " ")
        what = (
            f"a resistance to the journal's motion in {where}, by its closeness to the bearing,"
            if curve.direction == DAMPING
            else f"a {_PUSHES.get(curve.direction, 'force')} on the {where} ({curve.direction}) that depends "
            f"on {argument.replace('_', ' ')}{_rhythm(law)}"
        )
        lines.append(
            f"Something is missing that has no name here: {what} explains {share}the recordings; its table "
            "is in corrected.yaml."
        )
    for hypothesis in best.hypotheses:
        count = len(hypothesis.unknowns)
        shown = {}
        if hypothesis.effect is not None:
            for i, unknown in enumerate(hypothesis.unknowns):
                parameter, e = hypothesis.effect.parameter(unknown.name), values[place + i]
                shown[unknown.name] = (
                    f"{parameter.text(e.value)} ({parameter.text(e.low)} to {parameter.text(e.high)})"
                )
            lines.append(hypothesis.effect.describe(shown, joint))
        place += count
    if verdict == "unknown" and curve is None:
        lines = [f"The nearest explanation is not enough: {line[0].lower()}{line[1:]}" for line in lines]
        if nearer(explanation):
            body, direction = place_of(explanation, held_out)
            lines.append(
                f"A force without a name on the {str(body).replace('_', ' ')} ({direction}) comes nearer to "
                "one recording; no table of it was found that explains all."
            )
    if verdict == "unknown":
        lines += _gap(explanation)
    others = rivals(verdict, explanation)[1:]
    if others:
        names = " or ".join(" with ".join(h.name for h in a.hypotheses) for a in others)
        lines.append(f"With these sensors it cannot be told from {names}.")
    if best is explanation.shown and curve is not None:
        lines.append(
            "The balance of forces on the frame shows this. From one moment to the next a frame that is "
            "pushed moves as a free one does, so that one-step errors do not tell."
        )
        gain = (
            f"One-step errors are {held['after']:.3g} with it and {held['before']:.3g} without (floor 1.00)"
        )
    elif best is explanation.shown:
        rails = explanation.rails
        one = rails is not None and rails.followed
        lines.append(
            "One recording was followed so through its strikes, others were not: what else may be missing "
            "there is not said."
            if one
            else "The motion alone shows this: the slider moves as if between rails"
            f"{' on a frame that gives way' if rails is not None and rails.beside else ''}. "
            "No such machine was kept on the recordings through its strikes: what else may be missing is not "
            "said."
        )
        gain = f"One-step errors remain ({held['after']:.3g}, floor 1.00)"
    lines.append(
        f"{f'It shows{seen}. ' if seen else ''}{gain} and the clearance estimate changes from {before:.4f} "
        f"to {after:.4f} mm."
    )
    return lines


def _rhythm(law: object) -> str:
    """After what a force repeats by a clock of its own, in plain words."""
    period = getattr(law, "period", None)
    return f" and repeats every {period * 1e3:.4g} ms" if period is not None else ""


def _gap(explanation: Explanation) -> list[str]:
    """In plain words, that a gap was closed which the motion shows to be wide."""
    if not cushioned(explanation):
        return []
    assert explanation.agreed is not None
    joint, shown = explanation.agreed
    return [
        f"The motion shows some {shown * 1e3:.3f} mm of clearance in joint {joint}, and the nearest machine "
        "hardly any: something in the joint keeps the journal from striking."
    ]


def located(joints: dict[str, float]) -> list[str]:
    """In plain words, which of several joints was chosen, from the nominal machine's misfit with each."""
    (joint, least), *others = sorted(joints.items(), key=lambda one: one[1])
    return [
        f"The clearance is taken to be in joint {joint}: with it the nominal machine is {np.sqrt(least):.3g} "
        f"times as far from the recordings as a perfect one, with joint {other} {np.sqrt(misfit):.3g} times."
        for other, misfit in others
    ]
