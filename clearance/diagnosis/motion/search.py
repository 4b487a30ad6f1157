"""Which terms are missing: added one after the other, each judged after fitting it, and taken out again."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import log
from time import monotonic

import numpy as np

from clearance.diagnosis.motion.attempt import Attempt, Findings, inside, zero_of
from clearance.diagnosis.motion.beginning import begin
from clearance.diagnosis.motion.fit import fit
from clearance.diagnosis.motion.model import Model, Term
from clearance.diagnosis.motion.rest import Explained, explained
from clearance.diagnosis.motion.screening import screen
from clearance.diagnosis.motion.track import Track
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank

_NEARLY = 0.9  # of the gain of the best: so much from something simpler is preferred
_FITTED = 4  # terms that are fitted in a round, after screening all
_LEAST = 10.0  # decrease of the penalised cost for which a term is taken in
_SURE = 3.3  # standard deviations that the best-known size of a term must lie off zero
_PIECES, _TURNS, _FEWEST = 8, 2.5, 24  # pieces of all recordings; turns of the crank and samples of each
_LOOK = 8.0  # s of each recording that are searched; the result is fitted to all of them
_ALIKE = 10.0  # difference of prices below which two explanations are equivalent
_SECONDS = 60.0  # after which no further term is looked for
_POOR = 1.2  # residuals over noise from which on terms are not enough, or not rich enough
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
        speeds: tuple[float, float],
        workers: int,
        report: Callable[[str], None],
    ) -> None:
        self.tracks, self.terms, self.workers = list(tracks), terms, workers
        self.begin = np.array([begin(track, speeds) for track in tracks])
        every = {c for track in tracks for c in track.channels}
        self.model = Model(
            machine, joint, (), uncertain, "slider_position" in every,
            "crank_angle" in every and bool(every & {"slider_position", "slider_velocity"}),
        )  # fmt: skip
        self.in_pieces, self.speeds = False, speeds
        self.started, self._report = monotonic(), report

    def report(self, text: str) -> None:
        """Say how far it is."""
        self._report(f"[{monotonic() - self.started:.0f} s] {text}")

    @property
    def in_time(self) -> bool:
        """Whether there is time to look for more."""
        return monotonic() - self.started < _SECONDS

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
        found = fit(
            model, self.tracks, start, own, self.begin, self.workers, staged, _BRIEF if brief else _PATIENT
        )
        parameters = sum(len(term.unknowns) for term in terms)
        machine, _ = model.apply(found.shared)
        if machine.parameters()[Parameter.DRIVE_INTEGRAL_GAIN]:  # each recording has its own integral
            parameters += len(self.tracks)
        return Attempt(tuple(terms), found, found.cost + parameters * log(found.samples))

    def nominal(self) -> Attempt:
        """The machine as it is, its nuisance refitted."""
        start = np.array([u.prior[0] if u.prior else u.low for u in self.model.shared])
        return self.refilter(self.attempt((), start, self.begin, staged=True))

    def refilter(self, attempt: Attempt) -> Attempt:
        """The attempt, or the same terms with recordings that passed a filter, or did not, if that is better.

        Nothing in a file tells whether its positions and speeds went through the anti-alias filter of the
        usual measurement chain or were sampled as they were.
        """
        given = self.tracks
        if all(track.declared for track in given):
            return attempt
        self.tracks = [
            t if t.declared else replace(t, low_pass=None if t.low_pass else t.usual_low_pass) for t in given
        ]
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
        new = [t for t in self.terms.values() if t.place not in taken] if len(base.terms) < most else []
        richer = [
            (old, t)
            for old in base.terms
            for t in self.terms.values()
            if t.place == old.place
            and not {u.name for u in t.unknowns} <= {u.name for u in old.unknowns}
            and len(t.unknowns) >= len(old.unknowns)
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
        for old, term in richer if richer and self.judge(base).level.max() > _POOR else ():
            self.report(f"trying {term.label} for {old.label}")
            tried.append(self._changed(base, old, term))
        findings.attempts += tried
        better = [a for a in tried if a.price < base.price - _LEAST and self.sure(a)]
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
        """Whether every term is surely there, and none has run into a bound.

        A drive need not be: a motor becomes as soft as it can until what else is missing is found.
        """
        return all(
            attempt.sureness(term) > _SURE and not attempt.at_bound(term)
            for term in attempt.terms
            if term.linear
        )

    def prune(self, findings: Findings) -> None:
        """Take out terms, or parameters of them, without which the rest does as well."""
        while findings.best.terms:
            best = findings.best
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

    def run(self, most: int, keep: Callable[[Findings], None]) -> Findings:
        """The whole search: on the first seconds of each recording, then on all of it.

        Args:
            most: effects at once.
            keep: called after each round.
        """
        whole = self.tracks
        self.tracks = [track.part(0, round(_LOOK * track.rate)) for track in whole]
        self.report("fitting the machine as it is")
        nominal = self.nominal()
        findings = Findings(nominal, nominal)
        keep(findings)
        if not self.judge(nominal).enough:
            every = self.terms
            # a controller's two gains can imitate much; they are asked only where nothing else explains
            self.terms = {k: t for k, t in every.items() if "integral" not in t.effect.parameters}
            found, explains = self.search_pieces(most)
            self.terms = every
            if not explains and self.in_time:
                other, explains = self.search_pieces(most)
                found = other if explains else found
            findings.nominal = findings.best = self.attempt((), nominal.fit.shared, nominal.fit.own)
            if found.terms:
                self.report(f"fitting {found.label}")
                best = self.attempt(found.terms, inside(found), self.begin, staged=True)
                if best.price < findings.nominal.price:
                    findings.best = best
        keep(findings)
        while self.in_time and self.widen(findings, most):
            keep(findings)
        self.prune(findings)
        self.report("fitting the recordings' whole length")
        self.tracks = [replace(t, low_pass=part.low_pass) for t, part in zip(whole, self.tracks, strict=True)]
        self._refit(findings)
        if any(len(t.values) > _LOOK * t.rate for t in whole) and self.in_time and self.widen(findings, most):
            self.prune(findings)
        self.question_zero(findings)
        findings.enough = self.judge(findings.best)
        keep(findings)
        return findings

    def _refit(self, findings: Findings) -> None:
        """The best and the nominal attempt, fitted anew to the present recordings."""
        best, nominal = findings.best, findings.nominal
        findings.nominal = self.attempt((), nominal.fit.shared, nominal.fit.own, staged=True)
        findings.best = findings.nominal
        if best.terms:
            findings.best = self.attempt(best.terms, best.fit.shared, best.fit.own, staged=True)
            if findings.best.fit.samples != best.fit.samples:
                findings.attempts = []  # their prices are of other samples

    def search_pieces(self, most: int) -> tuple[Attempt, bool]:
        """The search on short pieces of the recordings, each with its own beginning and speed of the drive.

        Over many turns the crank's phase gathers whatever changes its mean speed, and a set of terms that is
        incomplete settles where their errors cancel there. A few turns cannot, so that what is missing is
        named one by one; a fit to the whole has the right terms to begin with.

        Returns:
            The best attempt, and whether what it leaves is of the size of the noise.
        """
        given, begun = self.tracks, self.begin
        turns = np.abs(begun[:, 3]) / 60.0
        self.tracks, rows = [], []
        for r, track in enumerate(given):
            size = max(_FEWEST, round(_TURNS / max(turns[r], 0.2) * track.rate))
            count = min(max(1, _PIECES // len(given)), max(1, len(track.values) // size))
            for place in np.linspace(0, max(len(track.values) - size, 0), count).astype(int):
                self.tracks.append(track.part(int(place), int(place) + size))
                rows.append(begin(self.tracks[-1], self.speeds))
        self.begin, self.in_pieces = np.array(rows), True
        start = np.array([u.prior[0] if u.prior else u.low for u in self.model.shared])
        nominal = self.attempt((), start, self.begin, staged=True)
        findings = Findings(nominal, nominal)
        while self.in_time and self.widen(findings, most):
            self.report(f"so far {findings.best.label}")
        self.prune(findings)
        explains = bool(findings.best.terms) and self.judge(findings.best).level.max() < _POOR
        filtered = self.tracks[0].low_pass is not None
        self.tracks = [
            t if t.declared else replace(t, low_pass=t.usual_low_pass if filtered else None) for t in given
        ]
        self.begin, self.in_pieces = begun, False
        return findings.best, explains

    def question_zero(self, findings: Findings) -> None:
        """Whether the encoder's zero, which was refitted throughout, is surely off."""
        best = findings.best
        if not best.fit.model.with_zero:
            return
        value, deviation = zero_of(best.fit)
        if abs(value) < _SURE * deviation:
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

    def equivalents(self, findings: Findings) -> list[Attempt]:
        """Attempts that explain the recordings as well as the best one with other effects."""
        best = findings.best
        if not best.terms and not findings.zero:
            return []
        names = {t.place for t in best.terms}
        found: dict[frozenset[tuple[str, str | None]], Attempt] = {}
        for one in [*findings.attempts, *findings.instead]:
            other = frozenset(t.place for t in one.terms)
            if (
                one.price < best.price + _ALIKE
                and (one in findings.instead or not (names <= other or other <= names))
                and self.sure(one)
                and (other not in found or one.price < found[other].price)
            ):
                found[other] = one
        return sorted(found.values(), key=lambda a: a.price)
