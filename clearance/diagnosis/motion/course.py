"""In which order recordings of the motion are searched, and on which pieces of them.

First on what linkage and measured turning suggest, then on short pieces, then on runs as long as the machine
is followed; the result is fitted to all of each recording.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.motion.attempt import Attempt, Findings, Remainder, inside
from clearance.diagnosis.motion.balance import Suggested, suggest
from clearance.diagnosis.motion.judged import squares
from clearance.diagnosis.motion.remainder import remainder
from clearance.diagnosis.motion.rest import Explained, nearly_all
from clearance.diagnosis.motion.search import FEWEST, POOR, SLOWEST, Search
from clearance.diagnosis.motion.track import Track
from clearance.errors import InputError

_LOOK = 8.0  # s of each recording that are searched; the result is fitted to all of them
_PIECES, _TURNS = 8, 1.25  # pieces of all recordings; turns of the crank in each
_STRETCHES = (10.0, 5.0, 2.5, 1.25)  # turns of the crank, from many to few
_SHORT = _STRETCHES[-2:]
_LOST = 2.5  # residuals over noise up to which what was suggested follows stretches


@dataclass(frozen=True)
class Course:
    """One search from the nominal machine on.

    Attributes:
        search: the recordings, and how to fit.
        most: effects at once.
    """

    search: Search
    most: int

    def run(self, keep: Callable[[Findings], None]) -> Findings:
        """The whole search: on the first seconds of each recording, then on all of it.

        Args:
            keep: called after each round.
        """
        search = self.search
        whole = search.tracks
        search.tracks = [track.part(0, round(_LOOK * track.rate)) for track in whole]
        search.report("fitting the machine as it is")
        nominal = search.nominal()
        if not np.isfinite(nominal.price):
            raise InputError(
                f"drive = {search.model.machine.drive}: too stiff, as it seems, for the machine to be run in "
                "steps of 5 us at least; lower drive.proportional (5 N m s/rad is the default), or set "
                "drive=direct_current_motor"
            )
        findings = Findings(nominal, nominal)
        keep(findings)
        if not search.judge(nominal).enough and not self._follow_suggested(findings):
            findings.best = self._pieced(nominal)
            if findings.best.terms and not search.judge(findings.best).enough:
                self._shorten(findings, search.tracks)
        keep(findings)
        while not search.late() and search.widen(findings, self.most):
            keep(findings)
        search.prune(findings)
        search.report("fitting the recordings' whole length")
        filtered = search.filtered
        whole = [track.filtered(filtered) for track in whole]
        self._refit(findings, search.cut(whole))
        longer = any(len(track.values) > _LOOK * track.rate for track in whole)
        if longer and not search.late() and search.widen(findings, self.most):
            search.prune(findings)
        search.drop(findings)
        search.question_zero(findings)
        findings.enough = search.judge(findings.best)
        keep(findings)
        if not (findings.enough.enough or search.late()):
            self._without_a_name(findings)
        return findings

    def _without_a_name(self, findings: Findings) -> None:
        """What is left as a force of free form, with recordings that passed a filter, or did not, anew."""
        search = self.search
        for _ in range(2):
            assert findings.enough is not None
            named = nearly_all(
                *(self._error(one, findings.enough) for one in (findings.nominal, findings.best))
            )
            left = findings.left = remainder(search, findings.best, named)
            if left is None or left.beside:
                return
            again = search.refilter(left.attempt)
            if again is left.attempt:
                return
            findings.nominal, findings.best = (
                search.attempt(one.terms, one.fit.shared, one.fit.own)
                for one in (findings.nominal, findings.best)
            )
            findings.attempts, findings.instead = [], []  # of other samples
            search.drop(findings)
            search.question_zero(findings)
            findings.enough, findings.left = search.judge(findings.best), Remainder(again, beside=False)

    def _error(self, attempt: Attempt, about: Explained) -> float:
        """Root mean square of what an attempt leaves over the noise."""
        return float(np.sqrt(squares(attempt.fit, self.search.tracks, about, about.noise).mean()))

    def _follow_suggested(self, findings: Findings) -> bool:
        """Begin with the best of what linkage and measured turning suggest; whether it follows them.

        It is fitted to stretches of few turns, over which a run from values that are nearly right stays near,
        and then to whole runs. Where these go astray all the same the stretches stay.
        """
        search = self.search
        whole, nominal = search.tracks, findings.nominal
        linked = list(zip(search.linkage.terms, search.linkage.values, strict=True))
        zeros = search.begin[:, 4].tolist()
        turns = np.maximum(np.abs(search.begin[:, 3]) / 60.0, SLOWEST).tolist()
        suggested = suggest(
            search.model, whole, zeros, turns, linked, list(search.terms.values()), search.report
        )
        for search.turns in _SHORT if suggested else ():
            search.tracks = search.cut(whole)
            search.begin = search.beginnings(search.tracks)
            findings.best = min((self._with(one, whole) for one in suggested), key=lambda a: a.price)
            if np.isfinite(findings.best.price) and search.judge(findings.best).level.max() < _LOST:
                break
        else:
            search.tracks, search.begin, search.turns = whole, search.beginnings(whole), None
            findings.best = nominal
            return False
        findings.nominal = search.attempt((), nominal.fit.shared, search.begin, staged=True)
        short = (search.tracks, search.begin, search.turns, findings.nominal, findings.best)
        search.report("fitting whole runs")
        search.turns = None
        self._refit(findings, whole)
        if not search.judge(findings.best).enough:
            search.tracks, search.begin, search.turns, findings.nominal, findings.best = short
            self._shorten(findings, whole)
        return True

    def _with(self, suggested: Suggested, whole: Sequence[Track]) -> Attempt:
        """A suggestion, fitted to the present stretches."""
        search = self.search
        terms, begun = (*search.linkage.terms, *suggested.terms), search.begin.copy()
        speeds = dict(zip((track.name for track in whole), suggested.speeds, strict=True))
        begun[:, 3] = [speeds[track.name] for track in search.tracks]
        search.report(f"trying {' + '.join(term.label for term in terms) or 'nothing more'}")
        start = np.concatenate([suggested.uncertain, *search.linkage.values, *suggested.values])
        return search.attempt(terms, start, begun, staged=True)

    def _linked(self) -> Attempt:
        """The machine with what the linkage alone says is missing."""
        search = self.search
        start = np.concatenate([search.nominal_values(), *search.linkage.values])
        return search.attempt(search.linkage.terms, start, search.begin, staged=True)

    def _pieced(self, nominal: Attempt) -> Attempt:
        """What a search on short pieces finds, fitted to the recordings; nothing if that is better."""
        search = self.search
        every = search.terms
        # a controller's two gains can imitate much; they are asked only where nothing else explains
        search.terms = {k: t for k, t in every.items() if "integral" not in t.effect.parameters}
        found, left = self._search_pieces()
        search.terms = every
        if left > POOR and not search.late():
            other, still = self._search_pieces()
            found = other if still < POOR else found
        best = search.attempt((), nominal.fit.shared, nominal.fit.own)
        if found.terms:
            search.report(f"fitting {found.label}")
            best = min(
                (best, search.attempt(found.terms, inside(found), search.begin, staged=True)),
                key=lambda a: a.price,
            )
        return best

    def _search_pieces(self) -> tuple[Attempt, float]:
        """The search on short pieces of the recordings, each with its own beginning and speed of the drive.

        Over many turns the crank's phase gathers whatever changes its mean speed, and a set of terms that is
        incomplete settles where their errors cancel there. A few turns cannot, so that what is missing is
        named one by one; a fit to the whole has the right terms to begin with.

        Returns:
            The best attempt, and what it leaves over the noise, of the worst channel.
        """
        search = self.search
        given, begun = search.tracks, search.begin
        turns = np.abs(begun[:, 3]) / 60.0
        search.tracks = []
        for r, track in enumerate(given):
            size = max(FEWEST, round(_TURNS / max(turns[r], SLOWEST) * track.rate))
            count = min(max(1, _PIECES // len(given)), max(1, len(track.values) // size))
            for place in np.linspace(0, max(len(track.values) - size, 0), count).astype(int):
                search.tracks.append(track.part(int(place), int(place) + size))
        search.begin, search.in_pieces = search.beginnings(search.tracks), True
        nominal = search.attempt((), search.nominal_values(), search.begin, staged=True)
        findings = Findings(nominal, min((nominal, self._linked()), key=lambda a: a.price))
        while not search.late() and search.widen(findings, self.most):
            search.report(f"so far {findings.best.label}")
        search.prune(findings)
        left = float(search.judge(findings.best).level.max()) if findings.best.terms else np.inf
        filtered = search.filtered
        search.tracks = [track.filtered(filtered) for track in given]
        search.begin, search.in_pieces = begun, False
        return findings.best, left

    def _shorten(self, findings: Findings, whole: Sequence[Track]) -> None:
        """Fit stretches of fewer turns, each with a beginning of its own, until the machine follows them.

        A real machine is pushed about by what no model has, and its crank's phase gathers that: over many
        turns it goes astray even from a right model, whose numbers bend to follow it.
        """
        search = self.search
        for turns in [turns for turns in _STRETCHES if turns < (search.turns or np.inf)]:
            before, search.turns = search.turns, turns
            stretches = search.cut(whole)
            if not len(stretches[0].values) < len(search.tracks[0].values):
                search.turns = before
                continue
            search.report(f"fitting stretches of {turns:g} turns")
            self._refit(findings, stretches)
            if search.judge(findings.best).enough:
                return

    def _refit(self, findings: Findings, tracks: list[Track]) -> None:
        """The best and the nominal attempt, fitted anew to other stretches of the recordings."""
        search = self.search
        best, nominal, names = findings.best, findings.nominal, [track.name for track in search.tracks]

        def again(attempt: Attempt) -> Attempt:
            begun = search.beginnings(tracks)
            for row, track in zip(begun, tracks, strict=True):
                same = [r for r, name in enumerate(names) if name == track.name]
                zero = attempt.fit.own[same, 4].mean()
                row[0], row[3:] = row[0] + row[4] - zero, (attempt.fit.own[same, 3].mean(), zero)
            return search.attempt(attempt.terms, attempt.fit.shared, begun, staged=True)

        search.tracks, search.begin = tracks, search.beginnings(tracks)
        findings.nominal = again(nominal)
        findings.best = again(best) if best.terms else findings.nominal
        if findings.best.fit.samples != best.fit.samples:
            findings.attempts = []  # their prices are of other samples
