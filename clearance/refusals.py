"""What Hydra and OmegaConf say of a wrong command line, in plain words: what is wrong, what to write."""

import inspect
import re
from contextlib import suppress
from typing import Any

from hydra.errors import OverrideParseException
from hydra.utils import get_object
from omegaconf import DictConfig, OmegaConf

from clearance.configuration import CONFIGURATION
from clearance.recording.bounds import listing, resembling

_BACKGROUND = re.compile(r"Config search path:.*|\s*object_type=.*|See https://\S+.*")
_NO_SUCH_KEY = re.compile(r"Could not override '([^']*)'\. To append to your config use \+(.*)")
_SEVERAL = re.compile(r"Ambiguous value for argument '(([^=]*)=(.*))' 1\. To use it as a list.*")
_NOT_GIVEN = re.compile(r"Missing mandatory value: \S+ full_key: (\S+)")
_NO_ARGUMENT = re.compile(
    r"Error in call to target '([^']*)': .*unexpected keyword argument '(\w+)'.* full_key: (\S+)"
)
_HINTS = {
    re.compile(r"(no viable alternative|mismatched input|extraneous input).*="): (
        "; inside a list or mapping, a value with = needs quotes: 'key=[\"a=1\"]'"
    ),
    re.compile(r"no viable alternative at input '[^=()]*$"): "; brackets, braces and quotes must be closed",
    re.compile(r"LexerNoViableAlt|token recognition error|no viable alternative at input '[^=]*[()]"): (
        "; inside a list or mapping, a name with ( ) & # or letters such as ü needs quotes: "
        "'recordings=[\"run (1).csv\"]'"
    ),
    re.compile(r"missing EQUAL"): "; write KEY=VALUE",
    re.compile(r"Could not find 'hydra/(launcher|sweeper)/"): (
        "; joblib, submitit_slurm and optuna come with pip install '.[sweeps]'"
    ),
    re.compile(r"Could not find 'mechanism/"): "; a machine of your own is a file, mechanism=FILE.yaml",
}


def reworded(error: BaseException, cfg: DictConfig | None) -> str:
    """One line about what a command line or a configuration got wrong, with what to write instead.

    Args:
        error: of Hydra's or OmegaConf's.
        cfg: what was composed, where it came that far.
    """
    said = one_line(error)
    if found := _NO_SUCH_KEY.fullmatch(said):
        return _no_such_key(error, found[1], found[2])
    if found := _SEVERAL.fullmatch(said):
        argument, key, values = found.groups()
        as_list = "" if (CONFIGURATION / key).is_dir() else f"; a list is '{key}=[{values}]'"
        return f"{argument}: several values are a sweep, which needs -m{as_list}"
    if found := _NOT_GIVEN.fullmatch(said):
        return f"Missing mandatory value: {found[1]} is not given; write {found[1]}=... (--help explains it)"
    if found := _NO_ARGUMENT.fullmatch(said):
        return _no_argument(cfg, *found.groups())
    if isinstance(error, OverrideParseException) and f"'{error.override}'" not in said:
        said = f"{error.override}: {said}"
    return said + "".join(hint for pattern, hint in _HINTS.items() if pattern.search(said))


def one_line(error: BaseException) -> str:
    """What an error says, without line breaks and without what only a developer needs."""
    return _BACKGROUND.sub("", " ".join(str(error).split())).strip()


def set_at(cfg: DictConfig, key: str) -> str:
    """Where the value of ``key`` is set: what interpolations on the way lead to."""
    path = ""
    for name in key.split("."):
        parent = OmegaConf.select(cfg, path) if path else cfg
        path = f"{path}.{name}" if path else name
        if isinstance(parent, DictConfig) and OmegaConf.is_interpolation(parent, name):
            written: Any = OmegaConf.to_container(parent, resolve=False)
            simple = re.fullmatch(r"\$\{([\w.]+)\}", written[name])
            path = simple[1] if simple else path
    return path


def _no_such_key(error: BaseException, key: str, override: str) -> str:
    cause, (above, _, name) = error.__cause__, key.rpartition(".")
    # OmegaConf names the first part that is missing: what stands beside it may be meant.
    known = getattr(cause, "parent_node", None) if getattr(cause, "full_key", None) == key else None
    names = [str(one) for one in known if one != "_target_"] if isinstance(known, DictConfig) else []
    near = resembling(name, names)
    others = "" if near or not above or not names else f"; {above} has {listing(names)}"
    added = "" if near or not above else f"; one that its file leaves out is given as +{override}"
    return f"Could not override '{key}': there is no such key{near}{others}{added}; --cfg job shows all keys"


def _no_argument(cfg: DictConfig | None, target: str, name: str, key: str) -> str:
    known: list[str] = []
    with suppress(Exception):  # a class that cannot be looked into has said what it does not take
        known = list(inspect.signature(get_object(target)).parameters)
    place = f"{key}.{name}" if cfg is None else set_at(cfg, f"{key}.{name}")
    takes = f"; {target.rpartition('.')[2]} takes {listing(known)}" if known else ""
    return f"{place}: there is no such key{resembling(name, known)}{takes}; leave {place} out"
