"""In which order explanations are tried, and when the search goes on."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting, gather
from clearance.diagnosis.hypotheses.missing_force import FREE_FORM
from clearance.diagnosis.searching import elsewhere, scrutiny
from clearance.diagnosis.searching.elsewhere import (
    _again,
    _of_other_sizes,
    _Tried,
    _try_out,
    begin_plausible,
    begin_sure,
)
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.scrutiny import _compare_kinds
from clearance.diagnosis.searching.significance import unsettled
from clearance.diagnosis.searching.strategy import _enough, _in_part, _named, _search_all, find_explanation
from clearance.diagnosis.searching.widen import deafen, glaring, kinds, look
from clearance.diagnosis.shooting.model import Unknown
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.judging.test_verdict import attempt


@pytest.fixture(autouse=True)
def still(monkeypatch):
    """A frame that no sensor feels shaking, and no force that the balance names beside a part."""
    for name in ("begin_frame", "begin_beside"):
        monkeypatch.setattr(f"clearance.diagnosis.searching.strategy.{name}", lambda *_: None)


GROUPS = sorted(
    gather(
        load_effects(["guide_friction", "restitution", "soft_drive"], []),
        Setting(SliderCrank(), "C").with_clearance(3e-4), "C", ("rod_c_axial",),
    ).values(),
    key=lambda group: ("guide_friction", "restitution", "soft_drive").index(group[0].name),
)  # fmt: skip


@pytest.mark.parametrize(
    ("nominal", "gain", "small", "expected"),
    [
        (1.02, 10.0, [], False),  # nothing is missing
        (1.02, 200.0, [], True),
        (1.19, 200.0, [1.18], True),  # a second clearance was taken for a heavier rod
        (1.19, 200.0, [1.01], False),
        (1.06, 200.0, [1.04], False),  # what a right model may leave
        (50.0, 200.0, [], False),
    ],
)
def test_something_small_that_leaves_most_does_not_end_the_search(nominal, gain, small, expected):
    attempts = [attempt(["rod_inertia"], misfit) for misfit in small]
    explanation = Explanation(attempt([], nominal), attempts, [SimpleNamespace(gain=gain)])
    assert unsettled(explanation) == expected


def test_what_a_look_is_sure_of_is_followed_anew_until_all_is_settled(monkeypatch):
    def hint(name, gain, fault=None):
        return SimpleNamespace(hypotheses=(SimpleNamespace(name=name, fault=fault),), values=[0.3], gain=gain)

    hints = [
        hint("worn_bearing", 200.0), hint("sensor_gain", 190.0, "gain"), hint("contact_stiffness", 180.0),
        hint("restitution", 170.0), hint("gravity", 20.0),
    ]  # fmt: skip
    explanation, tried = Explanation(attempt([], 1.18), [], hints), []

    def keep(explanation, held, make, again):
        assert again  # a fit beside the nominal path explains already, with a wrong size
        tried.append(held[0].name)
        if held[0].name == "contact_stiffness":
            explanation.attempts.append(attempt(["contact_stiffness"], 1.0))

    monkeypatch.setattr(elsewhere, "beside", lambda base, held, values: (held, values))
    begin_sure(SimpleNamespace(late=lambda: False, keep=keep), explanation)
    assert tried == ["worn_bearing", "contact_stiffness"]
    begin_sure(SimpleNamespace(late=lambda: True, keep=keep), Explanation(attempt([], 1.18), [], hints))
    assert len(tried) == 2


@pytest.mark.parametrize(
    ("nominal", "misfit", "expected"),
    [(200.0, 1.2, True), (200.0, 3.0, True), (200.0, 15.0, False), (8.0, 3.0, False)],
)
def test_a_table_ends_the_search_where_only_its_shape_can_be_missing(nominal, misfit, expected):
    assert _enough(Explanation(attempt([], nominal), [attempt(["free_form"], misfit)])) == expected


@pytest.mark.parametrize(
    ("loud", "scale", "expected"),
    [
        ({1: 10.0}, 1.0, "rod_c_axial"),
        ({1: 10.0, 2: 2.0}, 1.0, None),  # another one contradicts, too
        ({1: 1.2}, 1.0, None),
        ({1: 10.0}, 4.0, None),  # beside a smoothed path nothing is sure
    ],
)
def test_a_sensor_that_alone_contradicts_the_nominal_machine_glares(loud, scale, expected):
    residual = np.random.default_rng(0).normal(size=(60, 10, 3))
    for channel, factor in loud.items():
        residual[:, :, channel] *= factor
    measured = SimpleNamespace(channels=("rod_b_axial", "rod_c_axial", "slider_horizontal"))
    base = SimpleNamespace(
        scale=scale, fit=SimpleNamespace(passes=[SimpleNamespace(residual=residual)]),
        followers=[SimpleNamespace(measured=measured)],
    )  # fmt: skip
    assert glaring(base) == expected


def test_what_is_missing_inside_a_joint_is_not_looked_for_outside(monkeypatch):
    asked = []
    monkeypatch.setattr(
        elsewhere,
        "_try_out",
        lambda *of: asked.append({g[0].name for g in of[3]}),
    )
    nominal = attempt([], 400.0)
    effects = load_effects(["guide_friction", "rod_inertia", "restitution", "soft_drive"], [])
    inside = Hypothesis(
        "bushing", "physics", "joint_c", "normal", (Unknown("size", 1e-3),), *np.zeros((2, 1)), None
    )
    groups = gather(effects, Setting(SliderCrank(), "C").with_clearance(3e-4), "C", ("rod_c_axial",)).values()
    search = SimpleNamespace(others=lambda _: [*groups, [inside]])
    for balanced in (False, True):
        begin_plausible(search, Explanation(nominal, balanced=balanced), nominal)
    assert asked == [{"guide_friction", "rod_inertia", "bushing", "soft_drive"}, {"bushing"}]


def test_each_candidate_is_tried_though_something_small_explains():
    fitted = []
    nominal, small = attempt([], 1.19), attempt(["rod_inertia"], 1.18)
    explanation = Explanation(nominal, [small])
    for one in (nominal, small):
        one.misfits, one.label, one.fit.values = [one.misfit], "one", np.array([[3e-4, 700.0]])
        one.model = SimpleNamespace(shared=1)
    search = SimpleNamespace(
        starts=[SimpleNamespace(doubt=1.0)], late=lambda: False, report=lambda _: None,
        keep=lambda _, held, make: fitted.append(held[-1].name),
        setting=SimpleNamespace(model=lambda held: None, with_clearance=lambda _: SliderCrank()),
        finished=SimpleNamespace(followed=lambda *_: (None, np.zeros(3), 1.0)),
    )  # fmt: skip
    each = list({group[0].name: group for group in GROUPS}.values())
    _try_out(search, explanation, nominal, each[:2], None)
    assert fitted == ["guide_friction", "restitution"]


@pytest.mark.parametrize(
    ("name", "misfits", "expected"),
    [
        ("guide_friction", [0.9], 39.3),  # no flexible part: as it is
        ("rod_flexibility", [2.5, 0.99], 0.99),
        ("rod_flexibility", [None, 2.5, 30.0], 2.5),
        ("rod_flexibility", [50.0, None, 40.0], 39.3),
    ],
)
def test_a_flexible_part_is_followed_again_from_the_frequency_it_came_to(
    monkeypatch, name, misfits, expected
):
    begun, left = [], iter(misfits)

    def grow(start, model, row, limit):
        begun.append(row.tolist())
        misfit = next(left)
        return None if misfit is None else ("its path", np.array([9.6e-4, 346.0, 0.03, 700.0]), misfit)

    monkeypatch.setattr(elsewhere, "grow", grow)
    monkeypatch.setattr(elsewhere, "start_with", lambda *_: None)
    search = SimpleNamespace(
        setting=Setting(SliderCrank(), "C"), late=lambda: False, report=lambda _: None,
        finished=SimpleNamespace(followed=lambda label, make: make()),
    )  # fmt: skip
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    hypothesis = next(iter(gather(load_effects([name], []), machine, "C", ()).values()))[0]
    first = _Tried(39.3, [hypothesis], np.array([9.6e-4, 343.8, 0.006, 700.0]))
    assert _again(search, first, 0, 50.0, "nominal").misfit == expected
    dampings = [row[2] for row in begun]
    assert dampings == pytest.approx([0.01, 0.03, 0.05][: len(misfits) if name == "rod_flexibility" else 0])


def test_plausible_sizes_are_tried_before_other_shapes_of_one():
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    (group,) = gather(load_effects(["rod_flexibility"], []), machine, "C", ()).values()
    first = _of_other_sizes(group)[:3]
    assert [one.start[0] for one in first] == [300.0, 800.0, 2000.0]
    assert len({one.start[1] for one in first}) == 1
    assert len(_of_other_sizes(group)) == len(group)


@pytest.mark.parametrize(
    ("misfit", "channels", "left", "expected"),
    [
        (400.0, 7, 0.3, ["rod_b_axial"]),
        (400.0, 7, 0.45, []),  # the motion does not agree much better without it
        (400.0, 4, 0.3, []),  # none of four can be spared
        (10.0, 7, 0.3, []),  # the nominal path is near: other looks are cheaper
    ],
)
def test_a_sensor_that_the_motion_accuses_comes_before_forces(monkeypatch, misfit, channels, left, expected):
    asked = []
    nominal = attempt([], misfit)
    search = SimpleNamespace(
        recordings=[SimpleNamespace(channels=("rod_b_axial",) * channels)], late=lambda: len(asked) > 0
    )
    strategy = "clearance.diagnosis.searching.strategy."
    monkeypatch.setattr(
        strategy + "look", lambda *_: SimpleNamespace(plain=[], likely=[], unlikely=[], pairs=[])
    )
    monkeypatch.setattr(strategy + "glaring", lambda _: None)
    monkeypatch.setattr(strategy + "suggest_channels", lambda _: {"rod_b_axial": left})
    monkeypatch.setattr(strategy + "deafen", lambda *of: asked.append(of[3]))
    monkeypatch.setattr(strategy + "begin_balanced", lambda *_: asked.append("balance") or [])
    _search_all(search, Explanation(nominal), 3, lambda _: None)
    assert asked == [*expected, *([] if expected else ["balance"])]


def test_kinds_of_a_sensors_fault_are_compared_up_to_the_one_that_was_found(monkeypatch):
    refitted = []
    nominal, delay = attempt([], 1.1), attempt(["sensor_delay"], 1.0)
    kinds = [SimpleNamespace(name=f"sensor_{kind}") for kind in ("resonance", "delay", "gain")]
    monkeypatch.setattr(scrutiny, "kinds", lambda *_: [(kind, np.ones(1), 1.0) for kind in kinds])
    monkeypatch.setattr(scrutiny, "beside", lambda base, held, values: (held, values))
    nominal.followers, nominal.scale = [], 1.0
    search = SimpleNamespace(late=lambda: False, refit=lambda _, held, *more: refitted.append(held[0].name))
    for channel, expected in ((None, []), ("rod_c_axial", ["sensor_resonance"])):
        delay.hypotheses[0].channel = channel
        _compare_kinds(search, Explanation(nominal, [delay]), nominal)
        assert refitted == expected


@pytest.mark.parametrize(
    ("left", "expected"),
    [
        ([1.27, 1.37, 3.6], ["sensor_resonance", "sensor_delay"]),  # a damped resonance looks like a delay
        ([1.27, 1.60, 3.6], ["sensor_resonance"]),
    ],
)
def test_a_fault_that_explains_is_compared_with_those_that_look_alike(monkeypatch, left, expected):
    module = "clearance.diagnosis.searching.widen."
    explanation, refitted = Explanation(attempt([], 2.6)), []
    kinds = [SimpleNamespace(name=f"sensor_{kind}") for kind in ("resonance", "delay", "gain")]
    deaf = SimpleNamespace(misfit=0.8, followers=[])

    def refit(_, held, *more):
        refitted.append(held[0].name)
        explanation.attempts.append(attempt([held[0].name], 1.0))

    monkeypatch.setattr(module + "_deaf", lambda *_: deaf)
    monkeypatch.setattr(module + "beside", lambda base, held, values: (held, values))
    monkeypatch.setattr(
        module + "kinds", lambda *_: [(kind, np.ones(1), one) for kind, one in zip(kinds, left, strict=True)]
    )
    search = SimpleNamespace(report=lambda _: None, refit=refit, traces=[])
    deafen(search, explanation, explanation.nominal, "rod_c_transverse")
    assert refitted == expected


def test_a_signal_of_nothing_but_noise_is_clipped_by_no_limit(monkeypatch):
    effects = load_effects(["sensor_gain", "sensor_saturation"], [])
    channels = ("crank_a_transverse", "rod_c_axial")
    groups = gather(effects, Setting(SliderCrank(), "C").with_clearance(3e-4), "C", channels)
    ringing = np.sin(np.arange(4000) / 5.0)[:, None] * [0.1, 50.0]
    noise = 0.01 * np.random.default_rng(7).standard_normal(ringing.shape)
    for recorded, expected in ((noise, False), (np.clip(ringing, -30.0, 30.0) + noise, True)):
        measured = SimpleNamespace(
            values=recorded, sigma=np.full(2, 0.01), channels=channels, chain=SimpleNamespace(rate=1e4)
        )
        base = SimpleNamespace(fit=SimpleNamespace(passes=[SimpleNamespace(predicted=ringing)]))
        channel = channels[int(expected)]
        found = kinds(SimpleNamespace(groups=groups), base, [SimpleNamespace(measured=measured)], channel)
        assert ("sensor_saturation" in [hypothesis.name for hypothesis, _, _ in found]) == expected


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (attempt(["worn_bearing"], 1.31), ["worn_bearing"]),  # a rod that bends was missing, too
        (attempt(["worn_bearing"], 1.08), []),
        (attempt(["worn_bearing", "gravity", "soft_drive"], 1.31), []),  # no more may be missing
        (attempt([FREE_FORM], 1.31), []),
    ],
)
def test_effects_that_explain_less_than_right_ones_are_looked_beside(monkeypatch, found, expected):
    strategy = "clearance.diagnosis.searching.strategy."
    for name in ("_search_all", "enlarge", "scrutinise", "retry_nominal", "contest", "prune"):
        monkeypatch.setattr(strategy + name, lambda *_: None)
    beside = []
    monkeypatch.setattr(
        strategy + "begin_elsewhere", lambda _, __, base: beside.extend(h.name for h in base.hypotheses)
    )
    search = SimpleNamespace(late=lambda: False)
    find_explanation(search, Explanation(attempt([], 40.0), [found]), 3, lambda _: None)
    assert beside == expected


@pytest.mark.parametrize(("misfit", "expected"), [(1.02, []), (5.0, ["sensor_gain + worn_bearing"])])
def test_two_parts_that_do_not_explain_are_followed_on_paths_of_their_own(monkeypatch, misfit, expected):
    again = []
    nominal = attempt([], 40.0)
    explanation = Explanation(nominal, [attempt(["sensor_gain"], 11.0)])

    def widen(search, explanation, base, hints):
        if base is not nominal:
            pair = attempt(["sensor_gain", "worn_bearing"], misfit)
            pair.label = "sensor_gain + worn_bearing"
            explanation.attempts.append(pair)

    strategy = "clearance.diagnosis.searching.strategy."
    prospects = SimpleNamespace(plain=[], likely=[], unlikely=[], pairs=[])
    for name in ("glaring", "enlarge", "reshape", "begin_elsewhere"):
        monkeypatch.setattr(strategy + name, lambda *_: None)
    monkeypatch.setattr(strategy + "look", lambda *_: prospects)
    monkeypatch.setattr(strategy + "widen", widen)
    monkeypatch.setattr(strategy + "begin_again", lambda _, found: again.append(found.best.label))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: len(again) > 0)
    _search_all(search, explanation, 3, lambda _: None)
    assert again == expected


def test_what_promises_more_than_lobes_beside_a_part_is_tried_before_them(monkeypatch):
    asked = []
    nominal, gravity = attempt([], 40.0), attempt(["gravity"], 2.0)
    hints = [
        SimpleNamespace(hypotheses=(SimpleNamespace(name=name, fault=None),))
        for name in ("slider_offset", "worn_bearing", "guide_friction")
    ]
    strategy = "clearance.diagnosis.searching.strategy."
    for name in ("glaring", "enlarge", "reshape", "begin_elsewhere", "begin_again"):
        monkeypatch.setattr(strategy + name, lambda *_: None)
    none = SimpleNamespace(plain=[], likely=[], unlikely=[], pairs=[])
    monkeypatch.setattr(
        strategy + "look",
        lambda _, __, base: none if base is nominal else SimpleNamespace(plain=hints[:1], likely=hints[1:]),
    )
    monkeypatch.setattr(
        strategy + "widen", lambda _, __, ___, some: asked.append([h.hypotheses[0].name for h in some])
    )
    monkeypatch.setattr(strategy + "begin_wear", lambda *_: asked.append("wear"))
    search = SimpleNamespace(recordings=[SimpleNamespace(channels=())], late=lambda: len(asked) > 2)
    _search_all(search, Explanation(nominal, [gravity]), 3, lambda _: None)
    assert asked == [["slider_offset"], "wear", ["worn_bearing", "guide_friction"]]


@pytest.mark.parametrize(
    ("names", "misfit", "expected"),
    [
        (["slider_offset"], 10.1, True),  # a rod that bends was missing beside it
        (["slider_offset"], 14.0, False),
        (["rod_inertia"], 10.1, False),
        (["rod_inertia"], 7.0, True),
        (["rod_inertia"], 1.1, False),  # nothing is left
        ([FREE_FORM], 7.0, False),
        ([], 7.0, False),
    ],
)
def test_a_good_part_of_what_is_missing_is_built_on(names, misfit, expected):
    assert _in_part(attempt(names, misfit), attempt([], 25.2)) == expected


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (147.0, "torque_ripple"),  # a frame that gives way was missing beside it
        (40.0, FREE_FORM),
        (400.0, "torque_ripple"),
    ],
)
def test_a_table_that_leaves_much_is_not_built_on(table, expected):
    attempts = [attempt(["torque_ripple"], 305.0), attempt([FREE_FORM], table), attempt(["gravity"], 350.0)]
    found = _named(Explanation(attempt([], 1450.0), attempts))
    assert [h.name for h in found.hypotheses] == [expected]


def test_a_hint_begins_where_the_balance_of_work_saw_a_load(monkeypatch):
    def hypothesis(label):
        return SimpleNamespace(label=label, name=label, fault=None)

    hints = [Hint((hypothesis(name),), np.zeros(3), gain) for name, gain in (("load", 5.0), ("spring", 3.0))]
    found = SimpleNamespace(singles=hints, pairs=[])
    monkeypatch.setattr("clearance.diagnosis.searching.widen.screen", lambda *_: found)
    base = attempt(["gravity"], 4.0)
    base.label = "gravity"
    seen = np.array([2.9, 0.09, 0.14])
    explanation = Explanation(attempt([], 40.0), pushes=[(hypothesis("load"), seen)])
    search = SimpleNamespace(
        others=lambda _: [], setting=SimpleNamespace(joint="C"), workers=1, report=lambda _: None
    )
    prospects = look(search, explanation, base)
    begun = {hint.label: hint.values for hint in [*prospects.plain, *prospects.likely, *prospects.unlikely]}
    np.testing.assert_array_equal(begun["load"], seen)
    np.testing.assert_array_equal(begun["spring"], np.zeros(3))


@pytest.mark.parametrize(
    ("hinted", "unpushed", "expected"),
    [("worn_bearing", False, ["wear"]), ("gravity", True, ["wear"]), ("gravity", False, [])],
)
def test_lobes_are_read_off_the_motion_where_a_look_promises_them_or_no_force_helps(
    monkeypatch, hinted, unpushed, expected
):
    asked = []
    strategy = "clearance.diagnosis.searching.strategy."
    hint = SimpleNamespace(hypotheses=(SimpleNamespace(name=hinted, fault=None),))
    prospects = SimpleNamespace(plain=[hint], likely=[], unlikely=[], pairs=[])
    monkeypatch.setattr(strategy + "look", lambda *_: prospects)
    monkeypatch.setattr(strategy + "glaring", lambda _: None)
    monkeypatch.setattr(strategy + "suggest_channels", lambda _: {})
    monkeypatch.setattr(strategy + "settled", lambda *_: False)
    for name in ("balanced", "guide", "dimensions", "inside", "plausible"):
        monkeypatch.setattr(strategy + f"begin_{name}", lambda *_: [])
    monkeypatch.setattr(strategy + "widen", lambda *_: None)
    monkeypatch.setattr(strategy + "begin_wear", lambda *_: asked.append("wear"))
    search = SimpleNamespace(
        recordings=[SimpleNamespace(channels=("rod_b_axial",))], late=lambda: len(asked) > 0
    )
    monkeypatch.setattr(strategy + "fit_curve", lambda *_: None)
    monkeypatch.setattr(strategy + "suggest_curve", lambda *_: asked.append("curve") or ([], np.inf))
    monkeypatch.setattr(strategy + "begin_elsewhere", lambda *_: None)
    nominal = attempt([], 10.0)
    _search_all(search, Explanation(nominal, unpushed=unpushed), 3, lambda _: None)
    assert asked == (expected or ["curve"])
