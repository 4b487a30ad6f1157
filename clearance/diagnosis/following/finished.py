"""Fits that an earlier run on the same recordings has finished, so that they need not be made again."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from clearance.diagnosis.following.attempt import COARSE, FINE, Attempt
from clearance.diagnosis.following.growth import Followed, Start
from clearance.diagnosis.following.kept import Arrays, Kept, folder_in
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting
from clearance.diagnosis.kinematics.agreement import Alignment, Profile
from clearance.diagnosis.kinematics.reconstruction import Reconstruction
from clearance.diagnosis.sensing.measured import NO_FAULT, Measured
from clearance.diagnosis.sensing.tolerances import instrument_of, values_of
from clearance.diagnosis.shooting import follow
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model


class Finished(Kept):
    """The fits of one search, kept in a folder.

    Args:
        folder: for the files; ``None``: nothing is kept.
        recordings: that are fitted.
        report: called where they cannot be kept.
    """

    def __init__(
        self, folder: Path | None, recordings: Sequence[Measured], report: Callable[[str], None]
    ) -> None:
        super().__init__(folder, report)
        self.recordings = list(recordings)

    def attempt(
        self,
        hypotheses: Sequence[Hypothesis],
        model: Model,
        make: Callable[[], Attempt | None],
        workers: int,
    ) -> Attempt | None:
        """A fit to all recordings."""

        def pack(found: Attempt) -> dict[str, np.ndarray]:
            about = {"values": found.fit.values, "scale": np.array(found.scale)}
            return about | self._packed(found.followers)

        def unpack(kept: Arrays) -> Attempt:
            followers, scale = self._followers(kept), float(kept["scale"])
            again = fit(followers, model, kept["values"], 0, 1.0, workers, scale=scale)
            return Attempt(tuple(hypotheses), model, again, scale, again.level, followers)

        return self.recall(" + ".join(h.label for h in hypotheses), make, pack, unpack)

    def followed(self, label: str, make: Callable[[], Followed | None]) -> Followed | None:
        """A trial on one recording."""

        def pack(found: Followed) -> dict[str, np.ndarray]:
            follower, values, misfit = found
            return {"values": values, "misfit": np.array(misfit)} | self._packed([follower])

        def unpack(kept: Arrays) -> Followed:
            return self._followers(kept)[0], kept["values"], float(kept["misfit"])

        return self.recall(label, make, pack, unpack)

    def profile(self, make: Callable[[], Profile]) -> Profile:
        """How well the motion agrees with each clearance."""
        found = self.recall(
            "profile", make, lambda one: {"clearance": one.clearance, "misfit": one.misfit},
            lambda kept: Profile(kept["clearance"], kept["misfit"]),
        )  # fmt: skip
        assert found is not None
        return found

    def traces(self, alignments: Sequence[Alignment], make: Callable[[], list[Trace]]) -> list[Trace]:
        """The path of every recording."""

        def pack(found: list[Trace]) -> dict[str, np.ndarray]:
            packed = {}
            for r, one in enumerate(found):
                packed[f"{r} nodes"] = one.path.nodes
                packed[f"{r} numbers"] = np.array(
                    [one.path.misfit, one.path.force, one.path.speed, *one.arms]
                )
            return packed

        def unpack(kept: Arrays) -> list[Trace]:
            traces = []
            for r, (measured, alignment) in enumerate(zip(self.recordings, alignments, strict=True)):
                misfit, force, speed, crank, rod = map(float, kept[f"{r} numbers"])
                path = Reconstruction(kept[f"{r} nodes"], misfit, force, speed)
                traces.append(Trace(measured, alignment, path, (crank, rod)))
            return traces

        found = self.recall("traces", make, pack, unpack)
        assert found is not None
        return found

    def starts(self, traces: Sequence[Trace], make: Callable[[], list[Start]]) -> list[Start]:
        """Where every recording can be followed from."""

        def pack(found: list[Start]) -> dict[str, np.ndarray]:
            about = np.array([[one.island, one.doubt] for one in found])
            return {"about": about} | self._packed([one.follower for one in found])

        def unpack(kept: Arrays) -> list[Start]:
            each = zip(traces, self._followers(kept), kept["about"], strict=True)
            return [Start(trace, own, int(island), float(doubt)) for trace, own, (island, doubt) in each]

        found = self.recall("starts", make, pack, unpack)
        assert found is not None
        return found

    def _packed(self, followers: Sequence[Follower]) -> dict[str, np.ndarray]:
        names = [one.name for one in self.recordings]
        packed = {}
        for i, follower in enumerate(followers):
            measured = follower.measured
            r = names.index(measured.name)
            packed[f"{i} place"] = np.array([r, measured.first - self.recordings[r].first])
            packed[f"{i} nodes"], packed[f"{i} inputs"] = follower.path.nodes, follower.path.inputs
            packed[f"{i} sigma"] = follower.input_sigma
            if measured.sensors != NO_FAULT:
                what = measured.tolerances.open(measured.channels)
                packed[f"{i} sensors"] = np.array(values_of(what, measured.sensors))
                if measured.covariance is not None:
                    packed[f"{i} covariance"] = measured.covariance
            packed[f"{i} clock"] = np.array([measured.clock, measured.period])
            packed[f"{i} fine"] = np.array(follower.integrator == FINE)
        return packed

    def _followers(self, kept: Arrays) -> list[Follower]:
        followers: list[Follower] = []
        while (key := f"{len(followers)} ") + "place" in kept:
            r, first = map(int, kept[f"{key}place"])
            nodes = kept[f"{key}nodes"]
            clock, period = map(float, kept[f"{key}clock"])
            whole = replace(self.recordings[r], clock=clock, period=period)
            if f"{key}sensors" in kept:
                what = whole.tolerances.open(whole.channels)
                sensors = instrument_of(what, kept[f"{key}sensors"])
                whole = whole.calibrated(sensors, kept.get(f"{key}covariance"))
            measured = whole.part(first, first + len(nodes))
            integrator = FINE if kept[f"{key}fine"] else COARSE
            follower = Follower(measured, integrator, kept[f"{key}sigma"])
            follower.path = follow.Path(nodes, kept[f"{key}inputs"])
            followers.append(follower)
        return followers


def kept_in(
    root: Path | None,
    recordings: Sequence[Measured],
    alignments: Sequence[Alignment],
    setting: Setting,
    groups: Mapping[str, Sequence[Hypothesis]],
) -> Path | None:
    """The folder in ``root`` for the fits of one search: named by all that they depend on."""
    if root is None:
        return None
    content = hashlib.sha256()
    for one in recordings:
        content.update(one.values.tobytes())
    known = {
        "content": content.hexdigest(), "machine": setting.machine,
        "joint": setting.joint, "alignments": list(alignments),
        "recordings": [
            [one.name, one.channels, one.sigma.tolist(), one.chain, one.tolerances] for one in recordings
        ],
        "hypotheses": [
            [h.label, h.start.tolist(), h.off.tolist(), h.unknowns] for g in groups.values() for h in g
        ],
        "effects": [group[0].effect for group in groups.values()],
    }  # fmt: skip
    return folder_in(root, known)
