"""Which terms are missing: added one after the other, each judged after fitting it, and taken out again."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import log
from time import monotonic

import numpy as np

from clearance.diagnosis.motion.attempt import Attempt, Findings, inside, zero_of
from clearance.diagnosis.motion.balance import Suggested, suggest
from clearance.diagnosis.motion.beginning import begin
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
_PIECES, _TURNS, _FEWEST = 8, 1.25, 24  # pieces of all recordings; turns of the crank and samples of each
_STRETCHES, _MOST = (10.0, 5.0, 2.5, 1.25), 48  # turns of the crank, from many to few; so many stretches
_SHORT = _STRETCHES[-2:]
_LOOK = 8.0  # s of each recording that are searched; the result is fitted to all of them
_ALIKE = 10.0  # difference of prices below which two explanations are equivalent
_LOST = 2.5  # likewise, from which on a drive with a controller is looked for
_POOR = 1.2  # residuals over noise from which on terms are not enough, or not rich enough
_SLOWEST = 0.2  # turns a second, where lengths are counted in turns
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
    ) -> None:
        self.tracks, self.terms, self.workers, self.seconds = list(tracks), terms, workers, seconds
        self.linkage, self.speeds = linkage, speeds
        self.begin = self._begin(tracks)
        every = {c for track in tracks for c in track.channels}
        self.model = Model(
            machine, joint, (), uncertain, "slider_position" in every,
            "crank_angle" in every and bool(every & {"slider_position", "slider_velocity"}),
            linkage.deviation,
        )  # fmt: skip
        self.in_pieces = False
        self.turns: float | None = None
        self.started, self._report = monotonic(), report

    def report(self, text: str) -> None:
        """Say how far it is."""
        self._report(f"[{monotonic() - self.started:.0f} s] {text}")

    @property
    def in_time(self) -> bool:
        """Whether there is time to look for more."""
        return monotonic() - self.started < self.seconds

    def _begin(self, tracks: Sequence[Track]) -> np.ndarray:
        """(recordings, own unknowns) with which each begins."""
        return np.array([begin(track, self.speeds, self.linkage.zero(track.name)) for track in tracks])

    def _nominal_values(self) -> np.ndarray:
        """Shared unknowns of the nominal machine, on the scale of the fit."""
        return np.array([u.prior[0] if u.prior else u.low for u in self.model.shared])

    def _linked(self) -> Attempt:
        """The machine with what the linkage alone says is missing."""
        start = np.concatenate([self._nominal_values(), *self.linkage.values])
        return self.attempt(self.linkage.terms, start, self.begin, staged=True)

    def _follow_suggested(self, findings: Findings) -> bool:
        """Begin with the best of what linkage and measured turning suggest; whether it follows them.

        It is fitted to stretches of few turns, over which a run from values that are nearly right stays near,
        and then to whole runs. Where these go astray all the same the stretches stay.
        """
        whole, nominal = self.tracks, findings.nominal
        linked = list(zip(self.linkage.terms, self.linkage.values, strict=True))
        zeros = self.begin[:, 4].tolist()
        turns = np.maximum(np.abs(self.begin[:, 3]) / 60.0, _SLOWEST).tolist()
        suggested = suggest(self.model, whole, zeros, turns, linked, list(self.terms.values()), self.report)
        for self.turns in _SHORT if suggested else ():
            self.tracks = self.cut(whole)
            self.begin = self._begin(self.tracks)
            findings.best = min((self._with(one, whole) for one in suggested), key=lambda a: a.price)
            if np.isfinite(findings.best.price) and self.judge(findings.best).level.max() < _LOST:
                break
        else:
            self.tracks, self.begin, self.turns = whole, self._begin(whole), None
            findings.best = nominal
            return False
        findings.nominal = self.attempt((), nominal.fit.shared, self.begin, staged=True)
        short = (self.tracks, self.begin, self.turns, findings.nominal, findings.best)
        self.report("fitting whole runs")
        self.turns = None
        self._refit(findings, whole)
        if not self.judge(findings.best).enough:
            self.tracks, self.begin, self.turns, findings.nominal, findings.best = short
            self._shorten(findings, whole)
        return True

    def _with(self, suggested: Suggested, whole: Sequence[Track]) -> Attempt:
        """A suggestion, fitted to the present stretches."""
        terms, begun = (*self.linkage.terms, *suggested.terms), self.begin.copy()
        speeds = dict(zip((track.name for track in whole), suggested.speeds, strict=True))
        begun[:, 3] = [speeds[track.name] for track in self.tracks]
        self.report(f"trying {' + '.join(term.label for term in terms) or 'nothing more'}")
        start = np.concatenate([suggested.uncertain, *self.linkage.values, *suggested.values])
        return self.attempt(terms, start, begun, staged=True)

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
        return self.refilter(self.attempt((), self._nominal_values(), self.begin, staged=True))

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
        if not better and self.judge(base).level.max() > _POOR:
            for old, term in richer:
                if self.in_time:
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
        if not self.judge(nominal).enough and not self._follow_suggested(findings):
            findings.best = self._pieced(nominal, most)
            if findings.best.terms and not self.judge(findings.best).enough:
                self._shorten(findings, self.tracks)
        keep(findings)
        while self.in_time and self.widen(findings, most):
            keep(findings)
        self.prune(findings)
        self.report("fitting the recordings' whole length")
        filtered = self.tracks[0].low_pass is not None
        whole = [
            t if t.declared else replace(t, low_pass=t.usual_low_pass if filtered else None) for t in whole
        ]
        self._refit(findings, self.cut(whole))
        if any(len(t.values) > _LOOK * t.rate for t in whole) and self.in_time and self.widen(findings, most):
            self.prune(findings)
        self._drop(findings)
        self.question_zero(findings)
        findings.enough = self.judge(findings.best)
        keep(findings)
        return findings

    def _drop(self, findings: Findings) -> None:
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

    def _pieced(self, nominal: Attempt, most: int) -> Attempt:
        """What a search on short pieces finds, fitted to the recordings; nothing if that is better."""
        every = self.terms
        # a controller's two gains can imitate much; they are asked only where nothing else explains
        self.terms = {k: t for k, t in every.items() if "integral" not in t.effect.parameters}
        found, left = self.search_pieces(most)
        self.terms = every
        if left > _POOR and self.in_time:
            other, still = self.search_pieces(most)
            found = other if still < _POOR else found
        best = self.attempt((), nominal.fit.shared, nominal.fit.own)
        if found.terms:
            self.report(f"fitting {found.label}")
            best = min(
                (best, self.attempt(found.terms, inside(found), self.begin, staged=True)),
                key=lambda a: a.price,
            )
        return best

    def _shorten(self, findings: Findings, whole: Sequence[Track]) -> None:
        """Fit stretches of fewer turns, each with a beginning of its own, until the machine follows them.

        A real machine is pushed about by what no model has, and its crank's phase gathers that: over many
        turns it goes astray even from a right model, whose numbers bend to follow it.
        """
        for self.turns in [turns for turns in _STRETCHES if turns < (self.turns or np.inf)]:
            stretches = self.cut(whole)
            if len(stretches) > len(self.tracks):
                self.report(f"fitting stretches of {self.turns:g} turns")
                self._refit(findings, stretches)
                if self.judge(findings.best).enough:
                    return

    def cut(self, tracks: Sequence[Track]) -> list[Track]:
        """Recordings in the stretches over which they are compared."""
        if self.turns is None:
            return list(tracks)
        found = []
        for track in tracks:
            rate = abs(float(begin(track, self.speeds)[3])) / 60.0
            found.append(track.cut(max(_FEWEST, round(self.turns / max(rate, _SLOWEST) * track.rate))))
        every = -(-sum(map(len, found)) // _MOST)
        return [stretch for one in found for stretch in one[::every]]  # of each recording one at least

    def _refit(self, findings: Findings, tracks: list[Track]) -> None:
        """The best and the nominal attempt, fitted anew to other stretches of the recordings."""
        best, nominal, names = findings.best, findings.nominal, [track.name for track in self.tracks]

        def again(attempt: Attempt) -> Attempt:
            begun = self._begin(tracks)
            for row, track in zip(begun, tracks, strict=True):
                same = [r for r, name in enumerate(names) if name == track.name]
                zero = attempt.fit.own[same, 4].mean()
                row[0], row[3:] = row[0] + row[4] - zero, (attempt.fit.own[same, 3].mean(), zero)
            return self.attempt(attempt.terms, attempt.fit.shared, begun, staged=True)

        self.tracks, self.begin = tracks, self._begin(tracks)
        findings.nominal = again(nominal)
        findings.best = again(best) if best.terms else findings.nominal
        if findings.best.fit.samples != best.fit.samples:
            findings.attempts = []  # their prices are of other samples

    def search_pieces(self, most: int) -> tuple[Attempt, float]:
        """The search on short pieces of the recordings, each with its own beginning and speed of the drive.

        Over many turns the crank's phase gathers whatever changes its mean speed, and a set of terms that is
        incomplete settles where their errors cancel there. A few turns cannot, so that what is missing is
        named one by one; a fit to the whole has the right terms to begin with.

        Returns:
            The best attempt, and what it leaves over the noise, of the worst channel.
        """
        given, begun = self.tracks, self.begin
        turns = np.abs(begun[:, 3]) / 60.0
        self.tracks = []
        for r, track in enumerate(given):
            size = max(_FEWEST, round(_TURNS / max(turns[r], _SLOWEST) * track.rate))
            count = min(max(1, _PIECES // len(given)), max(1, len(track.values) // size))
            for place in np.linspace(0, max(len(track.values) - size, 0), count).astype(int):
                self.tracks.append(track.part(int(place), int(place) + size))
        self.begin, self.in_pieces = self._begin(self.tracks), True
        nominal = self.attempt((), self._nominal_values(), self.begin, staged=True)
        findings = Findings(nominal, min((nominal, self._linked()), key=lambda a: a.price))
        while self.in_time and self.widen(findings, most):
            self.report(f"so far {findings.best.label}")
        self.prune(findings)
        left = float(self.judge(findings.best).level.max()) if findings.best.terms else np.inf
        filtered = self.tracks[0].low_pass is not None
        self.tracks = [
            t if t.declared else replace(t, low_pass=t.usual_low_pass if filtered else None) for t in given
        ]
        self.begin, self.in_pieces = begun, False
        return findings.best, left

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
