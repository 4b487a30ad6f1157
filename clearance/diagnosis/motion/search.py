"""Which terms are missing: added one after the other, each judged after fitting it, and taken out again."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import log
from pathlib import Path
from time import monotonic

import numpy as np

from clearance.diagnosis.motion.attempt import Attempt, Findings, zeros_of
from clearance.diagnosis.motion.beginning import begin
from clearance.diagnosis.motion.finished import Finished, kept_in
from clearance.diagnosis.motion.fit import fit
from clearance.diagnosis.motion.linkage import Linkage
from clearance.diagnosis.motion.model import Model, Term
from clearance.diagnosis.motion.rest import Explained, explained
from clearance.diagnosis.motion.screening import screen
from clearance.diagnosis.motion.track import Track
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank

_NEARLY = 0.9  # of the gain of the best: so much from something simpler is preferred
_FITTED = 4  # terms that are fitted in a round, after screening all
_LEAST = 10.0  # decrease of the penalised cost for which a term is taken in
_OFF = 2.0  # standard deviations off zero, up to which a number of several may be off
_SURE = 3.3  # standard deviations that the best-known size of a term must lie off zero
FEWEST, _MOST = 24, 48  # samples of a stretch; stretches of all recordings
_ALIKE = 10.0  # difference of prices below which two explanations are equivalent
POOR = 1.2  # residuals over noise from which on terms are not enough, or not rich enough
SLOWEST = 0.2  # turns a second, where lengths are counted in turns
_PATIENT = 15  # iterations of a fit
_BRIEF = 6  # iterations of a fit that is only compared


class Search:
    """The recordings, the nominal model, and how to fit."""

    def __init__(
        self,
        tracks: Sequence[Track],
        machine: SliderCrank,
        joint: str,
        terms: dict[str, Term],
        uncertain: dict[str, tuple[float, float]],
        linkage: Linkage,
        speeds: tuple[float, float],
        seconds: float,
        workers: int,
        report: Callable[[str], None],
        finished: Path | None = None,
    ) -> None:
        self.tracks, self.terms, self.workers, self.seconds = list(tracks), terms, workers, seconds
        self.linkage, self.speeds = linkage, speeds
        self.begin = self.beginnings(tracks)
        self.recorded = sum(track.seconds for track in tracks)
        every = {c for track in tracks for c in track.channels}
        self.model = Model(
            machine, joint, (), uncertain, "slider_position" in every,
            "crank_angle" in every and bool(every & {"slider_position", "slider_velocity"}),
            linkage.deviation,
        )  # fmt: skip
        about = {"uncertain": uncertain, "speeds": speeds, "linked": linkage.zeros, "senses": linkage.turned}
        folder = kept_in(finished, self.tracks, self.model, terms, linkage, about)
        self.finished = Finished(folder, report)
        self.in_pieces = False
        self.turns: float | None = None
        self.started, self.stopped, self._report = monotonic(), "", report

    def report(self, text: str) -> None:
        """Say how far it is."""
        self._report(f"[{monotonic() - self.started:.0f} s] {text}")

    def late(self) -> bool:
        """Whether nothing new is to be tried; ``stopped`` says why."""
        if not self.stopped and monotonic() - self.started > self.seconds:
            self.stopped = "four fifths of time_limit were over (time_limit=null sets none)"
        if self.stopped:
            self.finished.stop()
        return bool(self.stopped)

    @property
    def filtered(self) -> bool:
        """Whether recordings that do not say through which filter they went are taken as filtered."""
        return any(track.low_pass is not None for track in self.tracks if not track.declared)

    def beginnings(self, tracks: Sequence[Track]) -> np.ndarray:
        """(recordings, own unknowns) with which each begins."""
        return np.array([begin(track, self.speeds, self.linkage.zero(track.name)) for track in tracks])

    def nominal_values(self) -> np.ndarray:
        """Shared unknowns of the nominal machine, on the scale of the fit."""
        return np.array([u.prior[0] if u.prior else u.low for u in self.model.shared])

    def _found(self, attempt: Attempt) -> list[Term]:
        """Terms that the linkage did not tell."""
        given = {term.place for term in self.linkage.terms}
        return [term for term in attempt.terms if term.place not in given]

    def attempt(
        self,
        terms: Sequence[Term],
        start: np.ndarray,
        own: np.ndarray,
        staged: bool = False,
        brief: bool = False,
    ) -> Attempt:
        """Fit a set of terms."""
        model = replace(self.model, terms=tuple(terms))
        iterations = _BRIEF if brief else _PATIENT
        found = self.finished.fitted(
            model, self.tracks, self.begin,
            lambda: fit(model, self.tracks, start, own, self.begin, self.workers, staged, iterations),
        )  # fmt: skip
        parameters = sum(len(term.unknowns) for term in terms)
        machine, _ = model.apply(found.shared)
        if machine.parameters()[Parameter.DRIVE_INTEGRAL_GAIN]:  # each recording has its own integral
            parameters += len(self.tracks)
        return Attempt(tuple(terms), found, found.cost + parameters * log(found.samples))

    def nominal(self) -> Attempt:
        """The machine as it is, its nuisance refitted."""
        return self.refilter(self.attempt((), self.nominal_values(), self.begin, staged=True))

    def refilter(self, attempt: Attempt) -> Attempt:
        """The attempt, or the same terms with recordings that passed a filter, or did not, if that is better.

        Nothing in a file tells whether its positions and speeds went through the anti-alias filter of the
        usual measurement chain or were sampled as they were.
        """
        given = self.tracks
        if all(track.declared for track in given):
            return attempt
        self.tracks = [track.filtered(not self.filtered) for track in given]
        other = self.attempt(attempt.terms, attempt.fit.shared, attempt.fit.own)
        # a filter's ends are not judged: costs are compared for each sample
        if other.fit.cost / other.fit.samples < attempt.fit.cost / attempt.fit.samples:
            return other
        self.tracks = given
        return attempt

    def widen(self, findings: Findings, most: int) -> bool:
        """Try one term more, or a richer variant of one; whether anything was gained."""
        base = findings.best
        taken = {term.place for term in base.terms}
        new = (
            [t for t in self.terms.values() if t.place not in taken] if len(self._found(base)) < most else []
        )
        richer = [
            (old, t)
            for old in base.terms
            for t in self.terms.values()
            if t.place == old.place
            and not {u.name for u in t.unknowns} <= {u.name for u in old.unknowns}
            and len(t.unknowns) >= len(old.unknowns)
            and (self.in_pieces or "integral" not in t.effect.parameters)
        ]
        screened = screen(base, new, self.tracks, self.begin, self.workers)
        findings.screened |= {label: gain for label, (gain, _) in screened.items()}
        promising = self._promising(screened)
        tried = []
        for label in promising:
            term = self.terms[label]
            self.report(f"trying {base.label} + {label}")
            start = np.concatenate([base.fit.shared, screened[label][1]])
            tried.append(self.attempt((*base.terms, term), start, base.fit.own))
        for term in new:
            if not term.linear and self.in_pieces:
                self.report(f"trying {base.label} + {term.label}")
                tried += self._from_starts(base, term)
        better = self._better(base, tried)
        if not better and self.judge(base).level.max() > POOR:
            for old, term in richer:
                if not self.late():
                    self.report(f"trying {term.label} for {old.label}")
                    tried.append(self._changed(base, old, term))
            better = self._better(base, tried)
        findings.attempts += tried
        if not better:
            return False
        gained = base.price - min(a.price for a in better)
        alike = [a for a in better if base.price - a.price > _NEARLY * gained]
        found = min(alike, key=lambda a: (len(a.fit.model.shared), a.price))
        refiltered = self.refilter(found)
        if refiltered is not found:  # prices of before were of other samples
            findings.nominal = self.attempt((), findings.nominal.fit.shared, findings.nominal.fit.own)
            findings.attempts = [refiltered]
        findings.best = refiltered
        return True

    def _better(self, base: Attempt, tried: Sequence[Attempt]) -> list[Attempt]:
        """Those that are worth their price and sure of their terms."""
        return [a for a in tried if a.price < base.price - _LEAST and self.sure(a)]

    def _promising(self, screened: dict[str, tuple[float, np.ndarray]]) -> list[str]:
        """Of the effects that promise most, the simplest variant that promises nearly as much."""
        most: dict[tuple[str, str | None], float] = {}
        for label, (gain, _) in screened.items():
            place = self.terms[label].place
            most[place] = max(most.get(place, _LEAST), gain)
        found = []
        for place in sorted(most, key=lambda place: -most[place]):
            alike = [
                label
                for label, (gain, _) in screened.items()
                if self.terms[label].place == place and gain > _NEARLY * most[place]
            ]
            if alike:
                found.append(min(alike, key=lambda v: (len(self.terms[v].unknowns), -screened[v][0])))
        return found[:_FITTED]

    def _from_starts(self, base: Attempt, term: Term) -> list[Attempt]:
        """A term that is far from linear: begun at each of its starts."""
        brief = [
            self.attempt(
                (*base.terms, term), np.concatenate([base.fit.shared, start]), base.fit.own, brief=True
            )
            for start in term.starts
        ]
        best = min(brief, key=lambda a: a.price)
        found = self.attempt(best.terms, best.fit.shared, best.fit.own)
        return [found] if np.isfinite(found.price) else []

    def _changed(self, base: Attempt, old: Term, new: Term | None) -> Attempt:
        """The base with another variant of one of its terms, begun at that one's values, or without it."""
        terms, start = [], [base.fit.shared[: len(base.fit.model.fixed_unknowns)]]
        for other in base.terms:
            values, _ = base.parameters(other)
            if other is not old:
                terms.append(other)
                start.append(values)
            elif new is not None:
                named = dict(zip((u.name for u in old.unknowns), values, strict=True))
                fresh = zip(new.unknowns, new.starts[0], strict=True)
                terms.append(new)
                start.append(np.array([named.get(u.name, first) for u, first in fresh]))
        return self.attempt(terms, np.concatenate(start), base.fit.own)

    def sure(self, attempt: Attempt) -> bool:
        """Whether every term that the linkage did not tell is surely there, and none has run into a bound.

        A drive need not be: a motor becomes as soft as it can until what else is missing is found.
        """
        return all(
            attempt.sureness(term) > _SURE and not attempt.at_bound(term)
            for term in self._found(attempt)
            if term.linear
        )

    def prune(self, findings: Findings) -> None:
        """Take out terms, or parameters of them, without which the rest does as well."""
        while findings.best.terms:
            best = findings.best
            self.report(f"asking what of {best.label} is needed")
            for old in best.terms:
                doubtful = best.doubtful(old)
                names = {u.name for u in old.unknowns}
                poorer: list[Term | None] = [
                    t
                    for t in self.terms.values()
                    if t.place == old.place and names - doubtful <= {u.name for u in t.unknowns} < names
                ]
                if names <= doubtful:
                    poorer.append(None)
                if self.in_pieces:  # another variant that is no part of this one, as a motor for a controller
                    poorer += [
                        t
                        for t in self.terms.values()
                        if t.place == old.place
                        and len(t.unknowns) <= len(names)
                        and not {u.name for u in t.unknowns} <= names
                    ]
                changed = [self._changed(best, old, new) for new in poorer]
                findings.attempts += [a for a in changed if a.terms]
                fewer = {a.label: len(a.fit.model.shared) < len(best.fit.model.shared) for a in changed}
                good = [
                    a
                    for a in changed
                    if a.price < best.price + _LEAST * (2 * fewer[a.label] - 1) and self.sure(a)
                ]
                if good:
                    findings.best = min(good, key=lambda a: (sum(len(t.unknowns) for t in a.terms), a.price))
                    break
            else:
                return

    def judge(self, attempt: Attempt) -> Explained:
        """Whether what is left is noise."""
        return explained(attempt.fit, self.tracks)

    def drop(self, findings: Findings) -> None:
        """Take out what is not surely there, the least sure first: nothing is asserted that may be off."""
        while True:
            best = findings.best
            changes: list[tuple[Term, Term | None]] = [
                (term, None)
                for term in sorted(best.terms, key=best.sureness)
                if term.linear and best.sureness(term) <= _SURE
            ]
            changes += [(term, new) for term in best.terms if (new := self._fewer(best, term)) is not None]
            if not changes:
                return
            old, fewer = changes[0]
            self.report(f"{fewer.label if fewer else 'nothing'} for {old.label}, which is not surely there")
            findings.best = self._changed(best, old, fewer)

    def _fewer(self, best: Attempt, term: Term) -> Term | None:
        """The variant of a term without those of its numbers that may be off, if there is one."""
        doubted = best.doubtful(term, _OFF)
        names = {u.name for u in term.unknowns} - doubted
        variants = [t for t in self.terms.values() if t.place == term.place] if doubted else []
        return next((t for t in variants if {u.name for u in t.unknowns} == names), None)

    def cut(self, tracks: Sequence[Track]) -> list[Track]:
        """Recordings in the stretches over which they are compared."""
        if self.turns is None:
            return list(tracks)
        found = []
        for track in tracks:
            rate = abs(float(begin(track, self.speeds)[3])) / 60.0
            found.append(track.cut(max(FEWEST, round(self.turns / max(rate, SLOWEST) * track.rate))))
        every = -(-sum(map(len, found)) // _MOST)
        return [stretch for one in found for stretch in one[::every]]  # of each recording one at least

    def question_zero(self, findings: Findings) -> None:
        """Whether the encoder's zero, which was refitted throughout, is surely off."""
        best = findings.best
        findings.zero, findings.zeros, findings.instead = False, {}, []
        if not best.fit.model.with_zero:
            return
        findings.zeros = zeros_of(best.fit, [track.name for track in self.tracks])
        if all(abs(value) < _SURE * deviation for value, deviation in findings.zeros.values()):
            return
        self.report("asking whether the encoder's zero is off")
        given = self.model
        self.model = replace(given, with_zero=False)
        own = best.fit.own.copy()
        own[:, 4] = 0.0
        without = self.attempt(best.terms, best.fit.shared, own)
        findings.zero = without.price > best.price + _LEAST
        if findings.zero:  # a channel that comes late looks alike while the speed is constant
            taken = {term.place for term in best.terms}
            for term in self.terms.values():
                if term.name == "sensor_delay" and term.place not in taken:
                    start = np.concatenate([without.fit.shared, term.starts[0]])
                    findings.instead.append(self.attempt((*best.terms, term), start, without.fit.own))
        self.model = given

    def equivalents(self, findings: Findings, zero_known: bool) -> list[Attempt]:
        """Attempts that explain the recordings as well as the best one with other effects.

        Args:
            findings: of the search.
            zero_known: whether an encoder's zero that is off is one of these effects, not a matter of course.
        """
        best, zero = findings.best, findings.zero and zero_known
        if not best.terms and not zero:
            return []
        names = {t.place for t in best.terms}
        found: dict[frozenset[tuple[str, str | None]], Attempt] = {}
        for one in [*findings.attempts, *(findings.instead if zero else [])]:
            other = frozenset(t.place for t in one.terms)
            if (
                one.price < best.price + _ALIKE
                and (one in findings.instead or not (names <= other or other <= names))
                and self.sure(one)
                and (other not in found or one.price < found[other].price)
            ):
                found[other] = one
        return sorted(found.values(), key=lambda a: a.price)
