"""What ``--help`` says of a command: the comments of its configuration file, and the options of its groups.

Hydra's own page lists every group there is and every number of the machine, without the files' comments.
"""

import re
from collections.abc import Collection, Iterator
from itertools import takewhile
from pathlib import Path

from clearance.configuration import CONFIGURATION

_LINE = re.compile(r"( *)([\w.]+):(?: +(.*?))?(?: *# *(.*))?")
_CHOICE = re.compile(r" +- (?:override |optional )?/?([\w/]+): *([^\s#]+)(?: *# *(.*))?")
_INCLUDED = re.compile(r" +- (\w+) *(?:#.*)?")
_WIDTH = 32

_MACHINE = """\
mechanism=FILE.yaml     a machine of your own; corrected.yaml of a diagnosis is one
mechanism.rod.mass=0.25 every number of a chosen option is a key, too: 'mechanism.gravity=[0,-9.81]'
"""
_MORE = """\
-m KEY=A,B              one run for each value (a sweep)
--cfg job               all keys and values, as they are with what stands before it
--hydra-help            the command line itself
"""


def help_text(name: str, unused: Collection[str] = ()) -> str:
    """The page of the command whose configuration is ``conf/NAME.yaml``, without groups that it refuses."""
    lines = _lines(CONFIGURATION / f"{name}.yaml")
    groups = {group: about for group, about in _groups(lines) if group not in unused}
    changed: dict[str, str] = {}
    if "experiment" in groups:
        known = {key.split(".")[0] for key, _, _ in _entries(lines)} | set(groups)
        chosen, options, comment = groups["experiment"]
        groups["experiment"] = chosen, [one for one in options if _fits(one, known)], comment
        if chosen in options:  # what holds where none is given is what the chosen experiment says
            own = _lines(CONFIGURATION / "experiment" / f"{chosen}.yaml")
            changed = {key: value for key, value, _ in _entries(own)}
            groups |= {group: (other, *groups[group][1:]) for group, (other, *_) in _groups(own)}
    keys = [
        (f"{key}={changed.get(key, value)}", comment)
        for key, value, comment in _entries(lines)
        if _told(key, value, comment)
    ]
    parts = ["\n".join(_purpose(lines)), "Keys, and what holds where none is given:\n" + _aligned(keys)]
    if groups:
        shown = [(f"{group}=", _options(*one)) for group, one in groups.items()]
        parts.append("Groups and their options, the chosen one first:\n" + _aligned(shown))
    return "\n\n".join([*parts, (_MACHINE if "mechanism" in groups else "") + _MORE])


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def _purpose(lines: list[str]) -> Iterator[str]:
    """The comment at the beginning of a file."""
    return (line[1:].removeprefix(" ") for line in takewhile(lambda line: line.startswith("#"), lines))


def _entries(lines: list[str]) -> Iterator[tuple[str, str, str]]:
    """Key with those above it, value and comment of each line; defaults and what is Hydra's left out.

    What a sweep of an experiment's own sweeps is among them.
    """
    above: list[str] = []
    for line in lines:
        found = _LINE.fullmatch(line)
        if found:
            indent, key, value, comment = found.groups()
            above = [*above[: len(indent) // 2], key]
            path = ".".join(above).removeprefix("hydra.sweeper.params.")
            if path.split(".")[0] not in ("defaults", "hydra"):
                yield path, value or "", comment or ""


def _told(key: str, value: str, comment: str) -> bool:
    """Whether a key is one that a user sets: it has a comment, or is no reference to another one."""
    return bool(value) and (bool(comment) or not ("." in key or "${" in value))


def _groups(lines: list[str]) -> Iterator[tuple[str, tuple[str, list[str], str]]]:
    """Groups of a file's defaults, and of the files that it includes: chosen option, all of them, comment."""
    for line in lines:
        included, found = _INCLUDED.fullmatch(line), _CHOICE.fullmatch(line)
        if included and (CONFIGURATION / f"{included[1]}.yaml").exists():
            yield from _groups(_lines(CONFIGURATION / f"{included[1]}.yaml"))
        if found and "$" not in found[2] and (CONFIGURATION / found[1]).is_dir():
            options = sorted(path.stem for path in (CONFIGURATION / found[1]).glob("[!_]*.yaml"))
            yield found[1], (found[2], options, found[3] or "")


def _fits(experiment: str, known: set[str]) -> bool:
    """Whether an experiment changes nothing but what a command has."""
    lines = _lines(CONFIGURATION / "experiment" / f"{experiment}.yaml")
    groups = {found[1] for line in lines if (found := _CHOICE.fullmatch(line))}
    return groups | {key.split(".")[0] for key, _, _ in _entries(lines)} <= known


def _options(chosen: str, options: list[str], comment: str) -> str:
    first = [chosen] if chosen in options else []
    text = ", ".join(first + [option for option in options if option not in first])
    return f"{text}   ({comment})" if comment else text


def _aligned(rows: list[tuple[str, str]]) -> str:
    return "\n".join(f"  {left:<{_WIDTH}}   {right}".rstrip() for left, right in rows)
