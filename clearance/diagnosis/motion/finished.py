"""Fits of whole runs that an earlier diagnosis of the same recordings has finished need not be made again."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clearance.diagnosis.following.kept import Kept, folder_in
from clearance.diagnosis.motion.fit import Fit, fit
from clearance.diagnosis.motion.linkage import Linkage
from clearance.diagnosis.motion.model import Model, Term
from clearance.diagnosis.motion.track import Track


class Finished(Kept):
    """The fits of one search, kept in a folder; without one none are."""

    def fitted(
        self, model: Model, tracks: Sequence[Track], begin: np.ndarray, make: Callable[[], Fit]
    ) -> Fit:
        """A fit of a model to recordings, or the one that was made at this place of the search before.

        Args:
            model: what is unknown.
            tracks: the recordings, or parts of them.
            begin: (recordings, OWN) first guesses.
            make: fits.
        """

        def pack(found: Fit) -> dict[str, np.ndarray]:
            return {"shared": found.shared, "own": found.own}

        def unpack(kept: Mapping[str, np.ndarray]) -> Fit:
            return fit(model, tracks, kept["shared"], kept["own"], begin, workers=1, iterations=0)

        parts = [f"{track.name}: {len(track.values)} samples" for track in tracks]
        found = self.recall(f"{[term.label for term in model.terms]}, {parts}", make, pack, unpack)
        assert found is not None
        return found


def kept_in(
    root: Path | None,
    tracks: Sequence[Track],
    model: Model,
    terms: Mapping[str, Term],
    linkage: Linkage,
    about: Mapping[str, Any],
) -> Path | None:
    """The folder in ``root`` for the fits of one search: named by all that they depend on.

    Args:
        root: of all searches; ``None``: nothing is kept.
        tracks: the recordings.
        model: of the nominal machine.
        terms: that are tried.
        linkage: what was found before any run.
        about: settings of the search.
    """
    if root is None:
        return None
    content = hashlib.sha256()
    for track in tracks:
        content.update(track.values.tobytes())
    for values in (*linkage.values, *(start for term in terms.values() for start in term.starts)):
        content.update(np.ascontiguousarray(values).tobytes())
    known = {
        "content": content.hexdigest(), "machine": model.machine, "joint": model.joint,
        "unknowns": model.fixed_unknowns, "settings": about,
        "recordings": [[t.name, t.channels, t.rate, t.low_pass, t.declared] for t in tracks],
        "terms": [[t.label, t.effect, t.unknowns, t.off.tolist()] for t in terms.values()],
        "linkage": [term.label for term in linkage.terms],
    }  # fmt: skip
    return folder_in(root, known)
