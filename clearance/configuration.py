"""Where the configuration lies, and mechanisms that lie elsewhere: in a file that a user names."""

import hashlib
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigLoadError
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from clearance.errors import InputError

_HERE = Path(__file__).parent
CONFIGURATION = _HERE / "conf" if (_HERE / "conf").is_dir() else _HERE.parent / "conf"
"""The configuration folder: inside the package in a wheel, beside it in a checkout."""

_MECHANISM_CLASS = re.compile(r"clearance\.mechanism\.\w+\.[A-Z]\w*")
"""What a mechanism's file may make objects of: a file that a user names runs no other code.

A name of one of its modules that begins as a class does: no function, and nothing inside what a module
imports.
"""
_REFERENCE = re.compile(r"\$\{\.*[\w.]+\}")  # to another key

_MECHANISM_FILE = re.compile(r"""mechanism=(['"]?)(.+\.ya?ml)\1""")


def with_mechanism_file(argument: str) -> str:
    """Turn ``mechanism=PATH.yaml`` into an option of the group ``mechanism``, and add that option to it.

    The option's name is the file's and a digest of what it says, so that a folder named by overrides belongs
    to one mechanism. Several files, separated by commas, are a sweep. Every other argument is returned as it
    is.

    Raises:
        InputError: if a file cannot be read or makes an object that is no part of a mechanism.
    """
    named = _MECHANISM_FILE.fullmatch(argument)
    if not named:
        return argument
    parts = named[2].split(",")
    several = not Path(named[2]).exists() and all(part.endswith((".yaml", ".yml")) for part in parts)
    return "mechanism=" + ",".join(_add_mechanism(Path(part)) for part in (parts if several else [named[2]]))


def set_key(override: str) -> str:
    """What an override of the command line sets."""
    return override.split("=")[0].lstrip("+~")


def with_mechanism_path(override: str) -> str:
    """The inverse of ``with_mechanism_file``, for a command that is shown: the file in its option's place."""
    group, _, option = override.partition("=")
    with suppress(ConfigLoadError):
        if group == "mechanism":
            return f"mechanism={ConfigStore.instance().load(f'mechanism/{option}.yaml').provider}"
    return override


def _add_mechanism(path: Path) -> str:
    try:
        text = path.read_bytes()
        node = OmegaConf.load(path)
        content = OmegaConf.to_container(node, resolve=False)
    except OSError as error:
        raise InputError(f"mechanism={path}: {error.strerror}; choose another file") from None
    except (YAMLError, OmegaConfBaseException, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"mechanism={path}: is no YAML file ({reason}); choose another file") from None
    if not isinstance(content, dict):
        raise InputError(f"mechanism={path}: holds no keys of a mechanism; choose another file")
    for called in _calls(content):
        raise InputError(
            f"mechanism={path}: {called[:60]!r} calls for more than another key's value, as "
            "${mechanism.rod.length} does; write the value itself"
        )
    for target in targets(content):
        if not _MECHANISM_CLASS.fullmatch(str(target)):
            raise InputError(
                f"mechanism={path}: _target_ = {target} is no class of clearance.mechanism; change _target_"
            )
    name = f"{re.sub(r'[^0-9A-Za-z_-]', '_', path.stem)}-{hashlib.sha256(text).hexdigest()[:8]}"
    ConfigStore.instance().store(name=name, node=node, group="mechanism", provider=str(path))
    return name


def set_defaults_of_plugins() -> None:
    """Let the values of ``conf/hydra/_plugins.yaml`` replace the plugins' own, where these are installed.

    Not by files in ``conf/hydra/launcher``: Hydra refuses a file beside a plugin's schema of the same name.
    """
    Plugins.instance()  # on the first call plugins store their configurations
    store = ConfigStore.instance()
    content: Any = OmegaConf.load(CONFIGURATION / "hydra/_plugins.yaml")
    for group, options in content.items():
        for name, values in options.items():
            with suppress(ConfigLoadError):
                stored = store.load(f"hydra/{group}/{name}.yaml")
                node = OmegaConf.merge(stored.node, values)
                store.store(name, node, f"hydra/{group}", stored.package, stored.provider)


def _calls(node: Any) -> Iterator[str]:
    """Texts with more than references to keys: a resolver could make what is not written."""
    if isinstance(node, str):
        left = node
        while left != (left := _REFERENCE.sub("", left)):
            pass
        if "${" in left:
            yield node
    for value in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from _calls(value)


def targets(node: Any) -> Iterator[Any]:
    """Every ``_target_`` inside nested mappings and lists."""
    if isinstance(node, dict):
        if "_target_" in node:
            yield node["_target_"]
        node = list(node.values())
    if isinstance(node, list):
        for value in node:
            yield from targets(value)
