"""Machines as nested mappings, as the configuration writes them: read, changed by path, compared, written.

A path such as ``joint_c.friction.friction_coefficient`` or ``gravity.1`` names one value of a machine.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from clearance.errors import InputError
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import Link, SliderCrank
from clearance.whole_files import write_yaml

_PARTS = (SliderCrank, Joint, Link)  # what a change goes into; a law is replaced as a whole
_PACKAGE = "clearance.mechanism."


def read_path(machine: SliderCrank, path: str) -> Any:
    """The value at a path.

    Raises:
        InputError: the machine, with its present laws, has no such value.
    """
    node: Any = machine
    for name in path.split("."):
        if isinstance(node, tuple) and name.isdigit() and int(name) < len(node):
            node = node[int(name)]
        elif is_dataclass(node) and name in {entry.name for entry in fields(node)}:
            node = getattr(node, name)
        else:
            raise InputError(
                f"mechanism.{path}: {type(node).__name__} has no {name!r}; change the law chosen there"
            )
    return node


def with_values(machine: SliderCrank, values: Mapping[str, Any]) -> SliderCrank:
    """The machine with other values at some paths, all set at once."""
    for path in values:
        read_path(machine, path)
    return _changed(machine, {tuple(path.split(".")): value for path, value in values.items()})


def _changed(node: Any, changes: Mapping[tuple[str, ...], Any]) -> Any:
    if () in changes:
        return changes[()]
    inner: dict[str, dict[tuple[str, ...], Any]] = {}
    for path, value in changes.items():
        inner.setdefault(path[0], {})[path[1:]] = value
    if isinstance(node, tuple):
        return tuple(
            _changed(item, inner[str(i)]) if str(i) in inner else item for i, item in enumerate(node)
        )
    return replace(node, **{name: _changed(getattr(node, name), below) for name, below in inner.items()})


def with_laws(machine: SliderCrank, patch: Mapping[str, Any]) -> SliderCrank:
    """The machine with the laws of a patch switched on.

    Args:
        machine: a law of it that is already of the patch's class is kept as it is.
        patch: nested like a mechanism's configuration; a law is a mapping with ``_target_``.
    """
    return _patched(machine, patch)


def _patched(node: Any, patch: Mapping[str, Any]) -> Any:
    changes: dict[str, Any] = {}
    for name, wanted in patch.items():
        present = getattr(node, name)
        if not isinstance(wanted, Mapping):
            changes[name] = wanted
        elif "_target_" not in wanted:
            changes[name] = _patched(present, wanted)
        else:
            made = _law(wanted)
            changes[name] = present if type(present) is type(made) else made
    return replace(node, **changes)


def _law(described: Mapping[str, Any]) -> Any:
    target = str(described["_target_"])
    module, _, name = target.rpartition(".")
    if not target.startswith(_PACKAGE):
        raise InputError(f"_target_ = {target} is no class of {_PACKAGE[:-1]}; change _target_")
    try:
        law = getattr(import_module(module), name)
        return law(**{key: value for key, value in described.items() if key != "_target_"})
    except (ImportError, AttributeError, TypeError) as error:
        raise InputError(f"_target_ = {target}: {error}; change _target_ or its keys") from None


def configuration_of(value: Any) -> Any:
    """A machine, or a part of one, as the configuration would write it."""
    if is_dataclass(value) and not isinstance(value, type):
        described = {"_target_": f"{type(value).__module__}.{type(value).__qualname__}"}
        return described | {
            entry.name: configuration_of(getattr(value, entry.name)) for entry in fields(value)
        }
    return list(value) if isinstance(value, tuple) else value


def difference(before: Any, after: Any) -> dict[str, Any]:
    """What a configuration must say to make ``after`` out of ``before``, nested; empty if they are equal.

    A law that differs is written out whole, with its ``_target_``.
    """
    changes: dict[str, Any] = {}
    for entry in fields(before):
        old, new = getattr(before, entry.name), getattr(after, entry.name)
        if old != new:
            alike = isinstance(new, _PARTS) and type(old) is type(new)
            changes[entry.name] = difference(old, new) if alike else configuration_of(new)
    return changes


def write_mechanism(path: Path, machine: SliderCrank, comment: str = "") -> None:
    """Write a machine as a file that every command takes as ``mechanism=PATH``.

    It says only what differs from the paper's machine, so that what it does not name can still be chosen on
    the command line.
    """
    content = {"defaults": ["slider_crank", "_self_"], **difference(SliderCrank(), machine)}
    radius = machine.joint_c.journal_radius
    if radius != machine.joint_b.journal_radius:  # where a file does not say C's, it has B's
        content.setdefault("joint_c", {})["journal_radius"] = radius
    write_yaml(path, content, comment)
