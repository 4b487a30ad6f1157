"""Machines as nested mappings: what is written makes the same machine again, by every command."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from clearance.configuration import CONFIGURATION, with_mechanism_file
from clearance.errors import InputError
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.contact import Flores
from clearance.mechanism.description import (
    configuration_of,
    difference,
    read_path,
    with_laws,
    with_values,
    write_mechanism,
)
from clearance.mechanism.drive import DirectCurrentMotor
from clearance.mechanism.friction import Coulomb
from clearance.mechanism.guide import StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.load import ConstantProcess
from clearance.mechanism.slider_crank import Link, SliderCrank

MACHINE = SliderCrank(
    rod=Link(0.25, 2.5e-4, 0.12, 0.45),
    gravity=(0.0, -9.81),
    joint_b=Joint(1e-4, contact=Flores(0.6)),
    joint_c=Joint(3e-4, friction=Coulomb(0.1)),
    guide_friction=StribeckGuide(5.0),
    drive=DirectCurrentMotor(2.0, 800.0),
    force=TabulatedForce("rod", "y", "time", 0.0, 0.1, (1.0, 2.0)),
)


def mechanism(*overrides):
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return instantiate(compose("simulate", list(overrides)).mechanism, _convert_="all")


def test_the_configuration_makes_the_default_machine():
    assert mechanism() == SliderCrank()


def test_a_written_machine_is_read_again(tmp_path):
    path = tmp_path / "corrected.yaml"
    write_mechanism(path, MACHINE, "found by a test\nin two lines")
    assert path.read_text().startswith("# found by a test\n# in two lines\ndefaults:")
    assert mechanism(with_mechanism_file(f"mechanism={path}")) == MACHINE


def test_joints_of_different_radii_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "corrected.yaml"
    for radii in ((0.02, 0.01), (0.01, 0.02), (0.02, 0.03)):
        joints = {f"joint_{name}": Joint(1e-4, journal_radius=r) for name, r in zip("bc", radii, strict=True)}
        write_mechanism(path, SliderCrank(**joints))
        assert mechanism(with_mechanism_file(f"mechanism={path}")) == SliderCrank(**joints)


def test_a_machine_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "corrected.yaml"
    write_mechanism(path, MACHINE)
    before = path.read_text()

    def full(file, text, **_):
        file.write_bytes(text[:20].encode())
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError, match=r"corrected\.yaml: not written"):
        write_mechanism(path, SliderCrank())
    assert path.read_text() == before
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_written_machine_does_not_name_is_still_chosen_on_the_command_line(tmp_path):
    path = tmp_path / "with, comma and =" / "only friction.yaml"
    path.parent.mkdir()
    write_mechanism(path, SliderCrank(guide_friction=StribeckGuide(5.0)))
    chosen = with_mechanism_file(f"mechanism={path}")
    assert chosen.startswith("mechanism=only_friction-")
    machine = mechanism(chosen, "contact=flores", "mechanism.gravity=[0,-9]", "process=constant")
    expected = SliderCrank(
        guide_friction=StribeckGuide(5.0),
        joint_b=Joint(contact=Flores()),
        joint_c=Joint(contact=Flores()),
        gravity=(0.0, -9.0),
        process=ConstantProcess(),
    )
    assert machine == expected


def test_several_files_are_a_sweep_and_a_changed_file_is_another_option(tmp_path):
    for name, force in (("a", 1.0), ("b", 2.0)):
        write_mechanism(tmp_path / f"{name}.yaml", SliderCrank(guide_friction=StribeckGuide(force)))
    swept = with_mechanism_file(f"mechanism={tmp_path}/a.yaml,{tmp_path}/b.yaml")
    assert [part.rpartition("-")[0] for part in swept.removeprefix("mechanism=").split(",")] == ["a", "b"]
    first = with_mechanism_file(f"mechanism={tmp_path}/a.yaml")
    write_mechanism(tmp_path / "a.yaml", SliderCrank(guide_friction=StribeckGuide(3.0)))
    assert with_mechanism_file(f"mechanism={tmp_path}/a.yaml") != first
    assert with_mechanism_file("mechanism=slider_crank") == "mechanism=slider_crank"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "No such file"),
        (
            "guide: {_target_: os.system, command: ls}",
            r"_target_ = os\.system is no class of clearance\.mech",
        ),
        ("force: {_target_: clearance.mechanism.slider_crank.np.load, file: a.npy}", "is no class of"),
        ("joint_b: [{_target_: '${oc.env:HOME}'}]", "calls for more than another key's value"),
        ("rod: '${oc.create:{_target_:builtins.print}}'", "calls for more than another key's value"),
        ("rod: ['${rod.${oc.env:HOME}}']", "calls for more than another key's value"),
        ("guide: [", "is no YAML file"),
        ("- 1", "holds no keys"),
    ],
)
def test_a_file_that_is_no_mechanism_is_refused(tmp_path, text, message):
    path = tmp_path / "wrong.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=f"mechanism=.*wrong.yaml: .*{message}"):
        with_mechanism_file(f"mechanism={path}")


def test_a_file_may_refer_to_its_own_keys(tmp_path):
    path = tmp_path / "related.yaml"
    path.write_text("defaults: [slider_crank, _self_]\nrod: {length: '${mechanism.crank.length}'}\n")
    assert with_mechanism_file(f"mechanism={path}").startswith("mechanism=related-")


def test_values_are_read_and_set_by_path():
    assert read_path(MACHINE, "gravity.1") == -9.81
    assert read_path(MACHINE, "joint_b.contact.restitution") == 0.6
    # both ends at once: one after the other they would cross
    process = with_values(
        replace(MACHINE, process=ConstantProcess()), {"process.start": 0.2, "process.end": 0.3}
    ).process
    assert (process.start, process.end) == (0.2, 0.3)
    assert with_values(MACHINE, {"gravity.0": 2.0}).gravity == (2.0, -9.81)
    for path in ("gravity.2", "joint_b.contcat", "process.force", "rod.mass.x"):
        with pytest.raises(InputError, match=rf"mechanism\.{path}: "):
            read_path(MACHINE, path)


def test_a_patch_switches_laws_on_and_keeps_those_that_are():
    wanted = {"guide_friction": configuration_of(StribeckGuide(1.0)), "joint_c": {"clearance": 2e-4}}
    machine = with_laws(SliderCrank(), wanted)
    assert machine.guide_friction == StribeckGuide(1.0)
    assert machine.joint_c.clearance == 2e-4
    assert with_laws(MACHINE, wanted).guide_friction == StribeckGuide(5.0)
    for target in ("os.system", "clearance.mechanism.guide.Nothing", "clearance.mechanism.nowhere.Law"):
        with pytest.raises(InputError, match=f"_target_ = {target}"):
            with_laws(MACHINE, {"guide": {"_target_": target}})


def test_a_difference_names_what_changed_and_nothing_else():
    assert difference(MACHINE, MACHINE) == {}
    assert difference(MACHINE, replace(MACHINE, rod=replace(MACHINE.rod, mass=0.3))) == {"rod": {"mass": 0.3}}
    changes = difference(SliderCrank(), MACHINE)
    assert set(changes) == {"rod", "gravity", "joint_b", "joint_c", "guide_friction", "drive", "force"}
    assert changes["force"]["values"] == [1.0, 2.0]
    assert yaml.safe_load(yaml.safe_dump(changes)) == changes
