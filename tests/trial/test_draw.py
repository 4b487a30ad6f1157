"""Cases: drawn from a seed, everything in every size, in circumstances that tell nothing."""

from collections import Counter

import pytest
import yaml
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from clearance.commands import CONFIGURATION
from clearance.errors import InputError
from clearance.trial.case import Case
from clearance.trial.draw import Drawing, Scope, counts
from clearance.trial.repertoire import EFFECTS, FAULTS, FORCES, LEFT_OUT, PLACES, SENSORS


def scope_of(*overrides):
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return instantiate(compose("trial", list(overrides)).scope, _convert_="all")


@pytest.fixture(scope="module")
def cases():
    scope = scope_of("experiment=trial_full")
    drawing = Drawing(scope, 3)
    return [drawing.case(i) for i in range(scope.cases)]


def test_the_whole_trial_has_everything_in_every_size(cases):
    assert len(cases) >= 400
    kinds = Counter(case.kind for case in cases)
    assert kinds["none"] == pytest.approx(0.25 * len(cases), abs=1)
    single = Counter((name, case.size) for case in cases if case.kind == "effect" for name in case.effects)
    assert set(single) == {(name, size) for name in EFFECTS for size in range(3)}
    assert min(single.values()) == max(single.values()) == 3
    faults = Counter((name, c.size) for c in cases if c.kind == "instrument" for name in c.faults)
    assert set(faults) == {(name, size) for name in FAULTS for size in range(3)}
    forces = Counter((c.force["of"], c.size) for c in cases if c.kind == "outside")
    assert set(forces) == {(name, size) for name in FORCES for size in range(3)}
    taken = {case.without for case in cases if case.kind == "left_out"}
    assert taken == {(name,) for name in LEFT_OUT}
    assert {len(case.missing) for case in cases if case.kind == "pair"} == {2}
    assert {case.sensors for case in cases} == set(SENSORS)
    assert {case.noise for case in cases} == {0.01, 0.05}
    assert {case.encoder for case in cases} == {True, False}


def test_triples_lack_three_different_things():
    scope = scope_of("experiment=trial_triples")
    drawing = Drawing(scope, 3)
    several = [drawing.case(i) for i in range(scope.cases)]
    assert {(case.kind, len(set(case.missing))) for case in several} == {("triple", 3)}
    assert {len(case.faults) for case in several} == {0, 1}
    for case in several:
        case.plant(case.sessions[0])


def test_every_case_is_a_machine_and_round_trips(cases):
    for case in cases:
        for session in case.sessions:
            case.plant(session)
        case.plant_faults()
        assert Case.from_json(case.to_json()) == case


def test_sensors_are_off_within_the_tolerances_that_the_tool_is_told():
    scope = scope_of("experiment=trial_sensors")
    drawing = Drawing(scope, 3)
    several = [drawing.case(i) for i in range(scope.cases)]
    for case in several:
        assert set(case.off) == set(SENSORS[case.sensors])
        assert case.public()["tolerances"] == scope.tolerances
        assert len(case.plant_faults()) == 4 * len(case.off) + len(case.faults)
        assert Case.from_json(case.to_json()) == case
    for name, neutral in (("gain", 1.0), ("misalignment", 0.0), ("delay", 0.0), ("bias", 0.0)):
        away = [one[name] - neutral for case in several for one in case.off.values()]
        limit = scope.tolerances[name]
        assert max(map(abs, away)) <= limit * (1.0 + 1e-12)
        assert 0.4 * limit < (sum(a * a for a in away) / len(away)) ** 0.5 < 0.55 * limit
    turned = [fault.angle for fault in several[0].plant_faults() if fault.kind == "sensor_misalignment"]
    assert 0.0 < max(map(abs, turned)) <= 2.0 * 3.1416 / 180.0  # the plant counts radians


def test_exact_sensors_are_drawn_as_if_none_could_be_off(cases):
    assert all(not case.off and "tolerances" not in case.public() for case in cases)


@pytest.mark.parametrize("given", [{"gain": 0.0}, {"gain": 3.0}, {"gain": "a bit"}, {"noise": 0.1}])
def test_wrong_tolerances_are_refused(given):
    with pytest.raises(InputError, match=r"change scope.tolerances"):
        Scope(tolerances=given)


def test_a_seed_decides_and_another_attempt_is_of_the_same_kind(cases):
    scope = scope_of("experiment=trial_full")
    again, other = Drawing(scope, 3), Drawing(scope, 4)
    assert [again.case(i) for i in range(20)] == cases[:20]
    assert [other.case(i).clearance for i in range(5)] != [case.clearance for case in cases[:5]]
    second = again.case(7, attempt=1)
    assert (second.kind, second.missing) == (cases[7].kind, cases[7].missing)
    assert second.clearance != cases[7].clearance


def test_what_the_tool_is_told_fits_many_kinds_of_case(cases):
    """A known moving frame and a hypothesis that is taken away must not give the truth away."""
    assert len({case.kind for case in cases if case.known_frame}) >= 4
    decoys = [case for case in cases if case.without and case.kind != "left_out"]
    assert {"none", "effect", "pair", "outside"} <= {case.kind for case in decoys}
    assert all(not set(case.without) & set(case.missing) for case in decoys)


def test_beams_are_rods_in_three_sizes_and_drawn_on_demand_alone():
    drawing = Drawing(scope_of("experiment=trial_beam"), 3)
    beams = [drawing.case(i) for i in range(6)]
    assert Counter(case.size for case in beams) == {0: 2, 1: 2, 2: 2}
    assert {(case.kind, case.joint, case.known_frame, case.missing) for case in beams} == {
        ("beam", "C", False, ("rod_flexibility",))
    }
    assert all(case.beam(session).rod_frequency > 300.0 for case in beams for session in case.sessions)
    assert "beam" not in Scope().shares
    assert "beam" not in scope_of().shares


def test_circumstances_do_not_depend_on_what_is_missing():
    drawn = []
    for kind in ("none", "effect"):
        scope = Scope(cases=8, shares={kind: 1.0})
        drawn.append([Drawing(scope, 5).case(i) for i in range(8)])
    for one, other in zip(*drawn, strict=True):
        assert (one.sessions, one.clearance, one.joint) == (other.sessions, other.clearance, other.joint)
        assert (one.sensors, one.noise, one.noise_seed) == (other.sensors, other.noise, other.noise_seed)


def test_pairs_and_triples_are_of_what_is_listed_where_that_is_enough():
    listed = ("gravity", "guide_friction", "rod_inertia", "sensor_gain")
    drawing = Drawing(Scope(cases=24, shares={"pair": 1.0, "triple": 1.0}, items=listed), 2)
    missing = [drawing.case(i).missing for i in range(24)]
    assert {name for names in missing for name in names} == set(listed)
    drawing = Drawing(Scope(cases=12, shares={"triple": 1.0}, items=("gravity", "rod_inertia")), 2)
    assert len({name for i in range(12) for name in drawing.case(i).missing}) > 6


def test_every_thing_that_may_be_missing_has_a_place():
    assert set(PLACES) == {*EFFECTS, *FAULTS}


def test_shares_become_whole_numbers():
    assert counts({"a": 1, "b": 1, "c": 1}, 10) in ({"a": 4, "b": 3, "c": 3},)
    assert counts({"a": 3, "b": 0, "c": 1}, 12) == {"a": 9, "b": 0, "c": 3}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"cases": 0}, "cases = 0 is not a whole number"),
        ({"cases": True}, "cases = True is not a whole number"),
        ({"shares": {"nothing": 1.0}}, "shares.nothing is unknown; choose from none.*change scope.shares"),
        ({"shares": {"none": -1.0}}, "change scope.shares"),
        ({"clearance_range": (1e-3, 1e-4)}, "change scope.clearance_range"),
        ({"seconds": (0.01, 1.0)}, "change scope.seconds"),
        ({"sensors": {"eleven": 1.0}}, "sensors.eleven is unknown"),
        ({"noise": ((0.01,),)}, "change scope.noise"),
        ({"noise": ((0.01, -1.0), (0.05, 2.0))}, "change scope.noise"),
        ({"noise": ()}, "change scope.noise"),
        ({"shares": None}, "shares = None .*change scope.shares"),
        ({"shares": {"none": "all"}}, "'all'.*change scope.shares"),
        ({"sensors": "all"}, "sensors = all .*change scope.sensors"),
        ({"noise": 0.01}, "noise = 0.01 .*change scope.noise"),
        ({"noise": ((0.01, "all"),)}, "'all'.*change scope.noise"),
        ({"seconds": 1.0}, "seconds = 1.0 .*change scope.seconds"),
        ({"speed_range": ("slow", "fast")}, "'slow', 'fast'.*change scope.speed_range"),
        ({"encoder": "yes"}, "encoder = 'yes' is no share"),
        ({"tolerances": None}, "tolerances = None.*change scope.tolerances"),
        ({"encoder": 1.5}, "encoder = 1.5 is no share"),
        ({"known_frame": -0.1}, "change scope.known_frame"),
    ],
)
def test_a_wrong_scope_is_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        Scope(**wrong)


def test_the_repertoire_speaks_the_diagnosis_language():
    """Names, parameters and places, written out in the trial, are those that a right verdict would use."""
    known = {
        path.stem: yaml.safe_load(path.read_text()) for path in (CONFIGURATION / "effect").glob("*.yaml")
    }
    assert {*EFFECTS, *FAULTS} == set(known)
    variants = {**EFFECTS, **{name: (variant,) for name, variant in FAULTS.items()}}
    for name, forms in variants.items():
        for form in forms:
            own = {"no_load_ratio"}  # a recording's own speed to the diagnosis
            assert {*form.sizes, *form.shape} - own <= set(known[name]["free"]), name
        assert known[name]["body"] in PLACES[name].bodies, name
        assert known[name]["direction"] in PLACES[name].directions, name
