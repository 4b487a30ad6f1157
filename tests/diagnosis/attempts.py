"""Attempts with known numbers, of which judging and searching make something."""

from types import SimpleNamespace

import numpy as np

from clearance.diagnosis.judging import play, verdict, words


def attempt(names, misfit, kind="physics", off=0.0, each=(), typical=()):
    hypotheses = tuple(
        SimpleNamespace(
            name=n,
            kind=kind,
            unknowns=(SimpleNamespace(name="size", low=-1e6, high=1e6),),
            off=np.array([off]),
            shapes=np.array([False]),
            effect=None,
            fault=None,
            channel=None,
        )
        for n in names
    )
    each = list(each) or [misfit]
    scale = 1.0 if misfit < 2 else 10.0
    passes = [
        SimpleNamespace(samples=10_000 // len(each), each=np.full(100, one / scale**2))
        for one in typical or each
    ]
    recorded = [SimpleNamespace(name=f"{r}.csv", first=0) for r in range(len(each))]
    followers = [SimpleNamespace(measured=one, segments=100) for one in recorded]
    return SimpleNamespace(
        hypotheses=hypotheses, label=" + ".join(names) or "nominal", labels=frozenset(names),
        misfit=misfit, level=misfit, scale=scale,
        withdrawn=False, reach=None, followers=followers, misfits=each, shares=(),
        fit=SimpleNamespace(passes=passes, cost=10_000 * misfit, bent=0.0),
        model=SimpleNamespace(shared=1 + len(names)),
    )  # fmt: skip


def known(monkeypatch, numbers):
    """Let every attempt's numbers be known."""
    for module in (verdict, words, play):
        monkeypatch.setattr(module, "estimates", numbers)
