"""A frame that its sensors feel shaking, and what is looked for beside it."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.kinematics.shaking import KNOTS
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.shaken import begin_frame, begin_shaking
from tests.diagnosis.attempts import attempt


@pytest.mark.parametrize("at_a", [True, False])
def test_rails_are_looked_for_on_a_frame_that_sensors_at_a_measure(monkeypatch, at_a):
    names = ("damping_ratio", "frequency", "mass")
    frame = SimpleNamespace(
        name="flexible_base", unknowns=[SimpleNamespace(name=n, low=0.0, high=1e3) for n in names],
        structural=lambda _: True, apply=lambda machine, _: machine,
    )  # fmt: skip
    machine = SimpleNamespace(parameters=lambda: None)
    swaying = SimpleNamespace()
    setting = SimpleNamespace(machine=machine, with_clearance=lambda _: machine, added=lambda *_: swaying)
    search = SimpleNamespace(
        groups={"frame": [frame]}, setting=setting, workers=1, report=lambda _: None, late=lambda: False,
        recordings=["one"], alignments=[SimpleNamespace(angle=0.0, speed=70.0)],
    )  # fmt: skip
    looked, tried, standing = [], [], []
    module = "clearance.diagnosis.searching.shaken."
    monkeypatch.setattr(module + "shakes", lambda *_: at_a)
    monkeypatch.setattr(module + "sways", lambda *_: True)
    for name in ("measure_frame", "find_frame"):
        monkeypatch.setattr(module + name, lambda *_: np.array([54.0, 0.01, 12.0]))
    monkeypatch.setattr(module + "profile", lambda *_: SimpleNamespace(best=1e-4))
    monkeypatch.setattr(module + "fit_from", lambda *_, **__: None)
    monkeypatch.setattr(module + "_forces_on", lambda *_: tried.append("forces") or [])
    monkeypatch.setattr(module + "suggest_dimensions", lambda search, _: standing.append(search) or [])

    def begin_guide(search, explanation, shown):
        looked.append(shown)
        explanation.rails = "rails"

    monkeypatch.setattr(module + "begin_guide", begin_guide)
    begin_frame(search, Explanation(attempt([], 50.0)))
    assert tried == ([] if at_a else ["forces"])
    if at_a:
        (shown,) = looked
        assert shown.hypotheses == (frame,)
        np.testing.assert_allclose(shown.sizes, [0.01, 54.0, 12.0])
        np.testing.assert_allclose(shown.deviations, [4e-3, 0.54, 0.24])  # the damping is never so sure
    else:
        assert looked == []
        (one,) = standing  # dimensions are told by the motion against the frame that sways
        assert (one.setting, one.profile.best) == (swaying, 1e-4)
        assert search.setting is setting


@pytest.mark.parametrize(("misfit", "kept"), [(30.0, True), (1.0, False)])
def test_a_push_that_does_not_explain_leaves_the_nominal_machine_as_it_was(monkeypatch, misfit, kept):
    module, nominal, pushed = (
        "clearance.diagnosis.searching.shaken.",
        attempt([], 1.0),
        attempt(["push"], misfit),
    )
    pushed.fit.values, pushed.followers = np.array([[1e-4, 0.0, 700.0]]), []
    found = SimpleNamespace(
        share=1.0, rhythm=SimpleNamespace(period=0.1), forces=np.ones(KNOTS), direction="x",
        interpolation="cubic",
    )  # fmt: skip
    monkeypatch.setattr(module + "find_shaking", lambda *_: found)
    monkeypatch.setattr(module + "free_form", lambda *_: SimpleNamespace(start=0.0))
    monkeypatch.setattr(module + "known_force", lambda *_: SimpleNamespace(start=0.0))
    monkeypatch.setattr(module + "fit_from", lambda *_, **__: pushed)
    refitted = attempt([], 1.1)
    search = SimpleNamespace(
        setting=SimpleNamespace(machine=None, joint="C", model=lambda: None), report=lambda _: None,
        recordings=[], alignments=[], workers=1, late=lambda: False, timed=lambda _: nullcontext(),
        profile=SimpleNamespace(best=1e-4), finished=SimpleNamespace(attempt=lambda *_: refitted),
    )  # fmt: skip
    explanation = Explanation(nominal)
    begin_shaking(search, explanation)
    assert explanation.nominal is (nominal if kept else refitted)
    assert explanation.shown is (None if kept else pushed)
