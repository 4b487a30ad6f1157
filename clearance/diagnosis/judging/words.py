"""A diagnosis in plain words: the headline first, then where it shows and how much better the fit is."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from clearance.diagnosis.following.attempt import EXPLAINED, Attempt, explained
from clearance.diagnosis.hypotheses.free_form import DAMPING, unnamed
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.judging.free_form import argument_of
from clearance.diagnosis.judging.play import NEAREST, clearance_of
from clearance.diagnosis.judging.verdict import (
    MOTION,
    borne_out,
    cushioned,
    drives,
    estimates,
    nearer,
    place_of,
    rattling,
    rivals,
    unconfirmed,
)
from clearance.diagnosis.searching.beside import HALFWAY
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import CLOCK, FRAME, GEOMETRIC
from clearance.diagnosis.searching.significance import CALM, SURE, null_scores, suspicious, usual
from clearance.mechanism.applied_force import TabulatedForce

_PUSHES = {"torque": "torque", "moment": "moment"}
_TOWARDS = {"x": ", along x", "y": ", along y", "normal": ", normal to the bearing"}
_EXPLAINED = EXPLAINED**0.5  # of errors, which are roots of mean squares
_LOST = 100.0  # times a perfect model's errors: how far off a path ends that is not followed says nothing
HELPS = 0.99  # of the held-out error before: what leaves more is not said to lower it


def sentences(
    verdict: str,
    explanation: Explanation,
    joint: str,
    fit: dict[str, Any],
    channels: Sequence[str],
    held_out: Attempt | None = None,
) -> list[str]:
    """The diagnosis in plain words, the headline first; ``held_out`` as of ``verdict_of``."""
    clearance = clearance_of(explanation)[0].value * 1e3
    held = fit["held_out"]
    if verdict == "none":
        return [
            f"Nothing is missing that these recordings could show: the clearance of joint {joint} is "
            f"{clearance:.4f} mm, and one-step errors are those of the noise ({held['after']:.2f}, floor "
            "1.00)."
        ]
    missed = unconfirmed(explanation, held_out)
    if missed:
        return [
            f"The fitted recordings show nothing missing: the clearance of joint {joint} is {clearance:.4f} "
            f"mm. But the path through what was held out of {' and '.join(missed)} was lost, so that it "
            "cannot be said that nothing is."
        ]
    seen = f" in {', '.join(channels)}" if channels else ""
    if verdict == "unknown" and not explanation.best.hypotheses:
        return _nothing_found(explanation, joint, held, seen, held_out)
    lines = _effects(explanation, joint)
    curve = unnamed(explanation.best.hypotheses)
    if verdict == "unknown" and (curve is None or not explained(explanation.best)):
        lines = [f"The nearest explanation is not enough: {line[0].lower()}{line[1:]}" for line in lines]
        lines += _nearer(explanation, held_out) if curve is None else []
    elif verdict == "unknown":
        lines = [f"Beside it, and not asserted: {line[0].lower()}{line[1:]}" for line in lines]
    if curve is not None:
        lines.insert(0, _free_force(explanation, curve, held_out))
        lines += _nearer(explanation, held_out)
    if verdict == "unknown":
        lines += [*_rattling(explanation), *_worked(explanation), *_gap(explanation)]
    others = rivals(verdict, explanation)[1:]
    if others:
        names = " or ".join(" with ".join(map(_called, a.hypotheses)) for a in others)
        lines.append(f"With these sensors it cannot be told from {names}.")
    if explanation.best is explanation.shown:
        lines.append(_shown_by_motion(explanation))
    return [*lines, _improvement(explanation, held, seen)]


def _nothing_found(
    explanation: Explanation, joint: str, held: dict[str, Any], seen: str, held_out: Attempt | None
) -> list[str]:
    """Of a mismatch for which nothing was found."""
    body, direction = place_of(explanation, held_out)
    guess = f" What comes nearest is {acting(body, direction)}." if body else ""
    shows = f"{f'It shows most{seen}.' if seen else 'No channel shows it alone.'}{guess}"
    if explained(explanation.nominal):
        clearance = clearance_of(explanation)[0].value * 1e3
        return [*_small(explanation, joint, clearance, held["after"]), shows]
    before, where = held["before"], ""
    if before < _EXPLAINED:  # what is missing does not show in what was held out
        before, where = float(np.sqrt(explanation.nominal.misfit)), ", where it was fitted"
    times = f"{before:.3g}" if before < _LOST else "more than 100"
    return [
        "Something is missing that none of the tried hypotheses explains: the nominal model's errors are "
        f"{times} times those of a perfect one{where}.",
        shows,
        *_rattling(explanation),
        *_gap(explanation),
    ]


def _rattling(explanation: Explanation) -> list[str]:
    """Of rails that the motion shows and between which no machine was followed."""
    if not rattling(explanation):
        return []
    return [
        "The slider moves across its guide as if between rails, so that it may be loose there; no such "
        "machine was kept on the recordings through its strikes."
    ]


def _called(hypothesis: Hypothesis) -> str:
    """A hypothesis by its name; a sensor's fault with its channel."""
    return f"{hypothesis.name} of {hypothesis.channel}" if hypothesis.channel else hypothesis.name


def _nearer(explanation: Explanation, held_out: Attempt | None) -> list[str]:
    """Of a force that comes nearer to one recording than what was found does to all."""
    if explanation.best is explanation.shown or not nearer(explanation):
        return []
    body, direction = place_of(explanation, held_out)
    return [
        f"Without a name, {acting(str(body), direction)} comes nearer to one recording; no table of "
        "it was found that explains all."
    ]


def _free_force(explanation: Explanation, curve: Hypothesis, held_out: Attempt | None) -> str:
    """Of a force without a name."""
    best, nominal = explanation.best, explanation.nominal
    law = curve.apply(nominal.model.machine(nominal.fit.values[0]), curve.start).force
    argument = argument_of(law) if isinstance(law, TabulatedForce) else ""
    rest = ""
    share = "a part of " if best.misfit > HALFWAY * nominal.misfit else "most of "
    if explained(best):
        told = best is explanation.shown or borne_out(explanation, held_out)
        share, rest = "", "" if told else " that were fitted, not those that were held out"
    what = f"{acting(curve.body, curve.direction)} that depends on {argument.replace('_', ' ')}{_rhythm(law)}"
    if curve.direction == DAMPING:
        what = (
            f"a resistance to the journal's motion in {_body(curve.body)}, by its closeness to the bearing,"
        )
    return (
        f"Something is missing that has no name here: {what} explains {share}the recordings{rest}; its table "
        "is in corrected.yaml."
    )


def _effects(explanation: Explanation, joint: str) -> list[str]:
    """Of the named effects of the best attempt, with their numbers."""
    best = explanation.best
    lines, place, values = [], 1, estimates(best)
    sure = explained(best) or best is explanation.shown  # else intervals say nothing
    for hypothesis in best.hypotheses:
        if hypothesis.effect is not None:
            shown, before = {}, []
            for i, (unknown, e) in enumerate(zip(hypothesis.unknowns, values[place:], strict=False)):
                parameter = hypothesis.effect.parameter(unknown.name)
                shown[unknown.name] = parameter.text(e.value, *((e.low, e.high) if sure else ()))
                if parameter.off is not None and hypothesis.off[i] != parameter.off:
                    before.append(f"{parameter.text(hypothesis.off[i])} ({unknown.name})")
            line = hypothesis.effect.describe(shown, joint)
            own = f" This is in the place of the model's own: {', '.join(before)}." if before else ""
            lines.append(f"{line}{own}")
        place += len(hypothesis.unknowns)
    return lines


def _shown_by_motion(explanation: Explanation) -> str:
    """Of what the motion shows, and one-step errors do not."""
    if unnamed(explanation.best.hypotheses) is not None:
        return (
            "The balance of forces on the frame shows this. From one moment to the next a frame that is "
            "pushed moves as a free one does, so that one-step errors do not tell."
        )
    rails = explanation.rails
    if rails is not None and rails.followed:
        return (
            "One recording was followed so through its strikes, others were not: what else may be missing "
            "there is not said."
        )
    beside = [] if rails is None else [hypothesis.name for hypothesis in rails.beside]
    where = {FRAME: " on a frame that gives way", CLOCK: " by a clock that is wrong"}
    forces = any(name not in (*where, *GEOMETRIC) for name in beside)
    return (
        "The motion alone shows this: the slider moves as if between rails"
        f"{''.join(where.get(name, '') for name in beside)}. "
        f"{'What else acts is known from the balance of work between them. ' if forces else ''}"
        "No such machine was kept on the recordings through its strikes: what else may be missing is not "
        "said."
    )


def _improvement(explanation: Explanation, held: dict[str, Any], seen: str) -> str:
    """How much better the fit is, and how the clearance changes."""
    best, (clearance, rests_on) = explanation.best, clearance_of(explanation)
    before, after = explanation.nominal.fit.values[0, 0] * 1e3, clearance.value * 1e3
    mismatch = f"The mismatch shows{seen}. " if seen else ""
    gain = _gain(explanation, held)
    if rests_on == MOTION and best is not explanation.shown:
        return f"{mismatch}{gain}."
    near = " (the nearest models'; no 95 % interval)" if rests_on == NEAREST else ""
    return f"{mismatch}{gain} and the clearance estimate changes from {before:.4f} to {after:.4f} mm{near}."


def _gain(explanation: Explanation, held: dict[str, Any]) -> str:
    """What becomes of the held-out error."""
    best, after = explanation.best, f"{held['after']:.3g}"
    if best is explanation.shown:
        if unnamed(best.hypotheses) is not None:
            return f"One-step errors are {after} with it and {held['before']:.3g} without (floor 1.00)"
        return f"One-step errors remain ({after}, floor 1.00)"
    if "lost" in held:
        return (
            "Every fitted recording is followed with it, and the motion shows that play as well; what was "
            f"held out was lost at the slider's strikes (errors {after}, floor 1.00),"
        )
    if "followed" in held:
        return (
            f"Where held-out recordings could be followed, errors are {held['followed']:.3g} with it (floor "
            "1.00); elsewhere its path was lost,"
        )
    them = {0: "it", 1: "it", 2: "both"}.get(len(best.hypotheses), "all of them")
    if not held["after"] < HELPS * held["before"]:
        gain = held.get("log_likelihood_gain", 0.0)
        if gain > 0.5 * SURE and held["after"] < held["before"] / HELPS:
            return (
                f"Held-out errors of quiet segments stay as they are ({after}, floor 1.00); impacts "
                f"included, those recordings are likelier with {them} (log-likelihood +{gain:.0f})"
            )
        return (
            f"It does not help on held-out recordings, where errors are {after} with {them} and "
            f"{held['before']:.3g} without (floor 1.00)"
        )
    without = f"{held['before']:.3g}" if held["before"] < _LOST else "more than 100"
    return f"With {them}, held-out error falls from {without} to {after} (floor 1.00)"


def _small(explanation: Explanation, joint: str, clearance: float, error: float) -> list[str]:
    """Of a nominal machine that explains what was fitted, why nothing missing is not what is said."""
    if suspicious(explanation) and error < _EXPLAINED:
        hint = explanation.hints[0] if explanation.hints else None
        most = null_scores()[-1]
        if hint is not None and hint.gain > most and not usual(explanation):
            promise = (
                f"{hint.label} promises more ({hint.gain:.0f}) than any effect did on machines that lack "
                f"nothing and were followed ({most:.0f} at most)"
            )
        elif explanation.nominal.misfit > CALM:
            promise = (
                f"what is left ({explanation.nominal.misfit:.2f}) is more than on machines that lack nothing"
            )
        else:
            promise = "the balance of forces on the frame shows a push that the model lacks"
        return [
            "The recordings are explained to within their noise, and yet something small may be missing: "
            f"{promise}. No effect was sure enough to be named. Without one, the clearance of joint "
            f"{joint} is {clearance:.4f} mm."
        ]
    return [
        "Something is missing that none of the tried hypotheses explains: what was fitted is explained as it "
        f"is, what was held out is not (errors {error:.3g}, floor 1.00)."
    ]


def _body(name: str) -> str:
    """Of the machine, in plain words: joint_b is joint B."""
    return f"joint {name[-1].upper()}" if name.startswith("joint_") else f"the {name.replace('_', ' ')}"


def acting(body: str, direction: str | None) -> str:
    """What acts on a body in a direction, in plain words."""
    if body == "instrument":
        return "a fault of an instrument"
    return f"a {_PUSHES.get(str(direction), 'force')} on {_body(body)}{_TOWARDS.get(str(direction), '')}"


def _rhythm(law: object) -> str:
    """After what a force repeats by a clock of its own, in plain words."""
    period = getattr(law, "period", None)
    return f" and repeats every {period * 1e3:.4g} ms" if period is not None else ""


def _worked(explanation: Explanation) -> list[str]:
    """Of the force that the balance of work points at, where that says more than what comes nearest."""
    worked = explanation.worked
    if worked is None or nearer(explanation) or cushioned(explanation) or not drives(explanation):
        return []
    return [
        f"By the balance of work {acting(worked.body, worked.direction)} gives the torque that the model "
        f"lacks, all but {worked.share:.0%}; no machine was kept on the recordings with it."
    ]


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
