"""Effects as files: what ``conf/effect`` describes, chosen by name, and refused where it describes none."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from clearance.configuration import CONFIGURATION
from clearance.diagnosis.hypotheses.effect import KINDS, NOMINAL, Effect, FreeParameter, Variant
from clearance.errors import InputError
from clearance.recording.bounds import listing, resembling


def load_effects(names: str | Sequence[str] = "all", without: Sequence[str] = ()) -> tuple[Effect, ...]:
    """The effects that a diagnosis tries.

    Args:
        names: ``all``, ``physics``, ``instrument``, one effect's name or several.
        without: names that are left out.

    Raises:
        InputError: a name that does not exist, or a file that describes no effect.
    """
    every = _all_effects()
    if isinstance(names, str):
        names = [names]
    wanted: dict[str, Effect] = {}
    for name in names:
        if name == "all":
            wanted |= every
        elif name in KINDS:
            wanted |= {effect.name: effect for effect in every.values() if effect.kind == name}
        else:
            wanted[name] = every[_known(name, every, "hypotheses", (*KINDS, "all"))]
    for name in without:
        wanted.pop(_known(name, every, "without"), None)
    return tuple(wanted.values())


def _known(name: str, every: Mapping[str, Effect], key: str, more: Sequence[str] = ()) -> str:
    if name not in every:
        allowed = [*more, *every]
        raise InputError(
            f"{key}: {name!r} is not an effect{resembling(str(name), allowed)}; choose from "
            f"{listing(allowed, len(allowed))}"
        )
    return name


@cache
def _all_effects() -> dict[str, Effect]:
    effects = [read_effect(path) for path in sorted((CONFIGURATION / "effect").glob("*.yaml"))]
    return {effect.name: effect for effect in effects}


def read_effect(path: Path) -> Effect:
    """The effect that a file describes.

    Raises:
        InputError: with the file, the key and what is allowed.
    """
    try:
        content = OmegaConf.to_container(OmegaConf.load(path), resolve=True)
        if not isinstance(content, dict):
            raise InputError("holds no keys")
        named: dict[str, Any] = {str(key): value for key, value in content.items()}
        for key, kind, called in (("free", dict, "mapping"), ("variants", list, "list")):
            if not isinstance(named.get(key) or kind(), kind):
                raise InputError(f"{key} = {named[key]!r} is no {called}")
        free = tuple(_parameter(name, entry) for name, entry in (named.pop("free", None) or {}).items())
        choices = tuple(_variant(entry) for entry in named.pop("variants", None) or ())
        effect: Effect = _made(Effect, {**named, "free": free, "choices": choices}, ("channel",))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except (YAMLError, OmegaConfBaseException) as error:
        raise InputError(f"{path}: is no YAML file ({' '.join(str(error).split())})") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if effect.kind not in KINDS:
        raise InputError(f"{path}: kind = {effect.kind!r} is not one of {', '.join(KINDS)}; change kind")
    if effect.name != path.stem:
        raise InputError(f"{path}: name = {effect.name!r} must be the file's, {path.stem!r}; change name")
    if not free:
        raise InputError(f"{path}: free names no parameter; give at least one")
    for choice in choices:
        for name in choice.free:
            try:
                effect.parameter(name)
            except InputError as error:
                raise InputError(f"{path}: variants: {error}") from None
    return effect


def _parameter(name: str, entry: Any) -> FreeParameter:
    if not isinstance(entry, dict):
        raise InputError(f"free.{name} = {entry!r} is no mapping")
    given = {str(key): value for key, value in entry.items()}
    try:
        for key in ("bounds", "trials"):
            if key in given:
                given[key] = tuple(float(value) for value in given[key])
        for key in ("start", "off"):
            if given.get(key) != NOMINAL and key in given:
                given[key] = float(given[key])
        if len(given.get("bounds", (0.0, 1.0))) != 2:
            raise InputError(f"bounds = {list(given['bounds'])} are not two numbers")
        if given.get("off") == NOMINAL:
            given["off"] = None
        return _made(FreeParameter, {"name": name, **given})
    except (TypeError, ValueError) as error:
        raise InputError(f"free.{name}: {error}") from None


def _variant(entry: Any) -> Variant:
    given = entry if isinstance(entry, dict) else {"free": entry}
    if not isinstance(given.get("free"), list) or not given["free"]:
        raise InputError(f"variants: {entry!r} names no parameters; give a list of names")
    return _made(Variant, {**given, "free": tuple(given["free"])})


def _made(kind: Any, given: Mapping[str, Any], hidden: Sequence[str] = ()) -> Any:
    """A dataclass from keys, with one line about keys that are unknown or missing."""
    allowed = [entry.name for entry in fields(kind) if entry.name not in hidden]
    unknown = [name for name in given if name not in allowed]
    if unknown:
        raise InputError(
            f"unknown key {unknown[0]!r}{resembling(unknown[0], allowed)}; allowed are {listing(allowed, 20)}"
        )
    needed = [e.name for e in fields(kind) if e.default is MISSING and e.default_factory is MISSING]
    missing = [name for name in needed if name not in given]
    if missing:
        raise InputError(f"the key {missing[0]!r} is missing; give {listing(needed, 20)}")
    return kind(**given)
