"""Build objects from a run folder's configuration without letting the file choose what code runs."""

import importlib
from typing import Any

from hydra.utils import instantiate
from torch import nn
from torch.optim import Optimizer

from clearance.errors import InputError

_PACKAGES = ("mechanism", "simulation", "recording", "models", "evaluation")


def instantiate_trusted(config: dict[str, Any], where: str) -> Any:
    """Instantiate ``config`` if each ``_target_`` in it is a class of this project, a layer or an optimiser.

    A run folder may come from someone else, and Hydra would call any function that it names.

    Args:
        config: Plain, without interpolations.
        where: The file, for the message.
    """
    for target in _targets(config):
        if not _allowed(target):
            raise InputError(
                f"{where}: names {target!r}: only this project's own classes, layers and optimisers "
                "of torch.nn and torch.optim are allowed; set checkpoint to what clearance.train wrote"
            )
    return instantiate(config)


def _targets(node: Any) -> list[Any]:
    if isinstance(node, dict):
        own = [node["_target_"]] if "_target_" in node else []
        return own + [target for value in node.values() for target in _targets(value)]
    if isinstance(node, list):
        return [target for value in node for target in _targets(value)]
    if isinstance(node, str) and "${" in node:
        return [node]  # an interpolation could fetch what is not in the file: refused as a target
    return []


def _allowed(target: Any) -> bool:
    if not isinstance(target, str):
        return False
    module_name, _, name = target.rpartition(".")
    if module_name in ("torch.nn", "torch.optim"):
        found = getattr(importlib.import_module(module_name), name, None)
        return isinstance(found, type) and issubclass(found, nn.Module | Optimizer)
    parts = module_name.split(".")
    if len(parts) != 3 or parts[0] != "clearance" or parts[1] not in _PACKAGES:
        return False
    try:
        found = getattr(importlib.import_module(module_name), name, None)
    except ImportError:
        return False
    # A function might write files: none but those that make metrics.
    if not isinstance(found, type) and module_name != "clearance.evaluation.metrics":
        return False
    # Defined there, not merely imported there.
    return getattr(found, "__module__", None) == module_name and getattr(found, "__qualname__", None) == name
