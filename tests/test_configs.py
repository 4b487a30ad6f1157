"""Every option of every configuration group composes, and makes what it says."""

import re
import shlex
from functools import cache
from pathlib import Path

import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.utils import get_object, instantiate

from clearance.commands import CONFIGURATION, _quoted
from clearance.mechanism.drive import Free
from clearance.provenance import describe

COMMANDS = sorted(path.stem for path in CONFIGURATION.glob("*.yaml") if path.stem != "machine")
GROUPS = sorted(
    path.name for path in CONFIGURATION.iterdir() if path.is_dir() and path.name not in ("effect", "hydra")
)
OPTIONS = sorted(
    (str(path.parent.relative_to(CONFIGURATION)), path.stem)
    for path in CONFIGURATION.glob("*/**/*.yaml")
    if not path.stem.startswith("_")
    and path.parent.name != "effect"  # what a diagnosis tries: test_effect.py
)
MACHINE = {group for group, _ in OPTIONS} & set(
    yaml.safe_load((CONFIGURATION / "mechanism/slider_crank.yaml").read_text())
)
IN_JOINTS = {"contact", "friction", "film", "bearing"}
PATH = {"stored": ["data.source.path=somewhere"], "measured": ["data.source.path=somewhere"]}
NEEDED = {**PATH, "worn": ["campaign.clearance_range=[3e-5,1e-3]"]}  # its lobes would close a smaller one


def composed(command, *overrides):
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return compose(command, list(overrides), return_hydra_config=True)


DESCRIBED = ("mechanism", "training", "scaling", "trial", "location", "paper", "placement")
PAGES = ("README.md", *(f"docs/{page}.md" for page in DESCRIBED))
TEXT = "\n".join((CONFIGURATION.parent / page).read_text() for page in PAGES).replace("\\\n", "")
SHOWN = [
    line
    for line in re.findall(r"^python -m clearance\..*$", TEXT, re.M)
    + [f"python -m {one}" for one in re.findall(r"^\| `(clearance\.[^`]+)`", TEXT, re.M)]
    if "hydra/sweeper" not in line  # in test_sweeps
    and "--help" not in line  # in test_help
    and "--cfg" not in line
    and "mechanism=press.yaml" not in line  # a file: in test_commands
]


@pytest.mark.parametrize("line", SHOWN)
def test_the_commands_that_are_shown_are_understood(line):
    _, _, module, *overrides = shlex.split(line, comments=True)
    for plugin in ("joblib", "submitit"):
        if any(one.startswith(f"hydra/launcher={plugin}") for one in overrides):
            pytest.importorskip(f"hydra_plugins.hydra_{plugin}_launcher")
    if "-m" in overrides:
        overrides.remove("-m")
        (jobs,) = BasicSweeper.split_arguments(OverridesParser.create().parse_overrides(overrides), None)
        overrides = jobs[0]
    assert composed(module.removeprefix("clearance."), *map(_quoted, overrides))


@cache
def selected(command):
    return set(composed(command).hydra.runtime.choices)


def overrides_for(group, option):
    if group.startswith("recipe/"):
        top = "scale" if (CONFIGURATION / f"scale/{group.split('/')[1]}.yaml").exists() else "experiment"
        return [f"{top}={group.split('/')[1]}", f"model={option}"]
    return [f"{group}={option}", *NEEDED.get(option, [])]


def command_of(group, option):
    if group == "experiment" and option.startswith("trial"):
        return "trial"
    if group == "experiment" and (option.startswith("figure") or option == "table7"):
        return "evaluate"
    return "train" if group.split("/")[0] in selected("train") else "bench"


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_composes(command):
    assert composed(command)


def test_every_group_is_selected_by_a_command():
    assert set(GROUPS) <= set.union(*(selected(command) for command in COMMANDS))


@pytest.mark.parametrize(("group", "option"), OPTIONS, ids=[f"{group}={option}" for group, option in OPTIONS])
def test_every_option_is_chosen_and_makes_what_it_says(group, option):
    command = command_of(group, option)
    cfg = composed(command, *overrides_for(group, option))
    top, _, experiment = group.partition("/")
    chosen = cfg.hydra.runtime.choices
    assert (f"{experiment}/{option}" if experiment else option) in (chosen[top], chosen.get(f"{top}@model"))
    if command == "trial":
        assert instantiate(cfg.scope, _convert_="all").cases == cfg.scope.cases
        return
    if command == "evaluate":
        figures, others = (instantiate(part, _convert_="all") for part in (cfg.figures, cfg.perturbations))
        assert all(hasattr(one, "draw") for one in figures.values())
        assert all(hasattr(one, "recordings") for one in others.values())
        assert list(figures) == [option] or (option == "table7" and len(others) == 6)
        return
    if option == "free":  # a simulated run begins at rest
        assert instantiate(cfg.mechanism, _convert_="all").drive == Free()
        return
    campaign = instantiate(cfg.campaign, _convert_="all")
    if top in MACHINE or top in IN_JOINTS:
        law = yaml.safe_load((CONFIGURATION / group / f"{option}.yaml").read_text())["_target_"]
        assert law.rpartition(".")[2] in str(describe(campaign.mechanism))
    if command == "train":
        instantiate(cfg.sensors)
        assert instantiate(cfg.data, _convert_="all").channels == tuple(cfg.sensors.channels)
        estimator = instantiate(cfg.model, _convert_="all")
        if hasattr(estimator, "net") or hasattr(estimator, "_build"):
            estimator._build(len(cfg.sensors.channels), cfg.windows.length, len(cfg.targets))
            windows = torch.zeros(2, cfg.windows.length, len(cfg.sensors.channels))
            assert estimator.net.eval()(windows).shape == (2, len(cfg.targets))


@pytest.mark.parametrize("path", sorted(CONFIGURATION.rglob("*.yaml")), ids=lambda path: str(path.name))
def test_every_target_can_be_imported(path):
    def targets(node):
        if isinstance(node, dict):
            own = [node["_target_"]] if "_target_" in node else []
            if own == ["hydra.utils.get_method"]:
                own.append(node["path"])
            return own + [target for value in node.values() for target in targets(value)]
        return [target for value in node for target in targets(value)] if isinstance(node, list) else []

    for target in targets(yaml.safe_load(Path(path).read_text())):
        assert callable(get_object(target)), target


def test_the_kinds_of_one_network_are_reduced_alike():
    for folder in {path.parent for path in (CONFIGURATION / "recipe").rglob("tdnn*.yaml")}:
        kinds = {path.stem for path in (CONFIGURATION / "model").glob("tdnn*.yaml")}
        assert {path.stem for path in folder.glob("tdnn*.yaml")} == kinds, folder


def test_every_recipe_belongs_to_an_experiment_or_scale_and_a_model():
    for path in (CONFIGURATION / "recipe").rglob("*.yaml"):
        parents = [CONFIGURATION / of / f"{path.parent.name}.yaml" for of in ("experiment", "scale")]
        assert any(parent.exists() for parent in parents), path
        assert (CONFIGURATION / "model" / f"{path.stem}.yaml").exists(), path
