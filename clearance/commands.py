"""What every command shares: where its configuration lies, how it logs, how it reports a wrong input."""

import errno
import logging
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from functools import wraps
from types import FrameType, MappingProxyType
from typing import Any, NoReturn

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from clearance.configuration import CONFIGURATION, set_defaults_of_plugins, set_key, with_mechanism_file
from clearance.errors import InputError
from clearance.help import help_text
from clearance.recording.bounds import whole
from clearance.refusals import one_line, reworded, set_at

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_UNKNOWN_KEY = re.compile(r"the key that ends in '(\w+)'")
_PATH_WITH_KEYS = re.compile(r"""([\w.]+)=(?!\w+\(.*\)$)([^'"\[{$(][^'"]*=[^'"]*)""")
_PATH_WITH_QUOTES = re.compile(r"""([\w.]+)=([^'"\[{$(]*/[^"$(]*'[^"$(]*)""")
_LIST_OF_OPTIONS = re.compile(r"(\w+)=\[(.*,.*)\]")
_ADDED = re.compile(r"\+\+?(\w+)=.*")


def refuse(unused: Mapping[str, str]) -> None:
    """Refuse what a command's configuration has and the command does not use.

    Args:
        unused: groups of keys, each with a word on what is used instead.

    Raises:
        InputError: one was set on the command line.
    """
    for one in HydraConfig.get().overrides.task:
        group = set_key(one).split(".")[0].split("@")[0]
        if group in unused:
            raise InputError(f"{one}: {unused[group]}; leave {group} out")


def command(
    name: str, resumes: bool = True, unused: Mapping[str, str] = MappingProxyType({})
) -> Callable[[Callable[[DictConfig], Any]], Callable[[], Any]]:
    """Make a function of a configuration into a command with Hydra's command line.

    A wrong input ends the command with one line on standard error and exit code 2; so does a full disk. Asked
    to end (SIGTERM, as a queue or a shutdown does, or SIGHUP, as a terminal that is closed) it ends as after
    Ctrl-C, with what it started.

    Args:
        name: of the file in ``conf/``.
        resumes: whether what was done before an interruption is kept and gone on from.
        unused: groups of keys in that file that are refused, see ``refuse``.
    """

    def decorate(task: Callable[[DictConfig], Any]) -> Callable[[], Any]:
        @wraps(task)
        def guarded(cfg: DictConfig) -> Any:
            # Here too: Hydra adds a line of its own to what leaves a job. A copy: instantiating changes cfg.
            several = HydraConfig.get().mode is RunMode.MULTIRUN
            alone = _failing_alone(deepcopy(cfg)) if several else _reported(deepcopy(cfg), resumes)
            with alone:
                refuse(unused)
                return task(cfg)

        run = hydra.main(version_base="1.3", config_path=str(CONFIGURATION), config_name=name)(guarded)

        @wraps(task)
        def main() -> Any:
            os.environ["HYDRA_FULL_ERROR"] = "1"  # let errors through, instead of Hydra's own report of them
            before, threading.excepthook = threading.excepthook, _thread_error
            for one in (signal.SIGTERM, signal.SIGHUP):
                if signal.getsignal(one) is not signal.SIG_IGN:  # as nohup has it
                    signal.signal(one, _terminated)
            try:
                with _reported(resumes=resumes):
                    if {"--help", "-h"} & set(sys.argv[1:]):
                        sys.stdout.write(help_text(name, unused))
                        return None
                    set_defaults_of_plugins()
                    for argument in sys.argv[1:]:
                        _require_one_option(argument)
                        _require_known(argument)
                    sys.argv[1:] = [_quoted(with_mechanism_file(argument)) for argument in sys.argv[1:]]
                    return run()
            finally:
                threading.excepthook = before

        return main

    return decorate


def threads(count: Any) -> int | None:
    """The number of threads that ``workers`` asks for; ``None``: all cores.

    Raises:
        InputError: it is no number of threads.
    """
    whole(count, "workers", 1, null=True)
    return None if count is None else int(count)


def shard(text: object) -> tuple[int, int]:
    """The part and the number of parts that ``shard=k/n`` asks for.

    Raises:
        InputError: it is no part of a number.
    """
    try:
        part, parts = (int(word) for word in str(text).split("/"))
    except ValueError:
        raise InputError(f"shard = {text!r} must be k/n, for example shard=3/16") from None
    if not 1 <= part <= parts:
        raise InputError(f"shard = {part}/{parts} must be k/n with 1 <= k <= n; change shard")
    return part, parts


@contextmanager
def _reported(cfg: DictConfig | None = None, resumes: bool = True) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        _interrupted(cfg, resumes)
    except Exception as error:
        # Ctrl-C between two steps of a library can leave it unable to shut down: no error of the user's.
        if any(isinstance(link, KeyboardInterrupt) for link in _chain(error)):
            _interrupted(cfg, resumes)
        wrong = _wrong_input(error, cfg)
        if wrong is None:
            raise
        logging.getLogger(__name__).debug("wrong input", exc_info=error)
        sys.stderr.write(f"error: {wrong}\n")
        raise SystemExit(2) from None


def _terminated(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


@contextmanager
def _failing_alone(cfg: DictConfig) -> Iterator[None]:
    """A job of a sweep says what is wrong with it; the process goes on with the next one."""
    try:
        yield
    except Exception as error:
        if any(isinstance(link, KeyboardInterrupt) for link in _chain(error)):
            raise KeyboardInterrupt from None
        logger, wrong = logging.getLogger(__name__), _wrong_input(error, cfg)
        if wrong is None:
            logger.exception("failed")
            # Another type: not every exception can be sent from one process to another.
            raise RuntimeError(f"{type(error).__name__}: {one_line(error)}") from None
        logger.error("failed: %s", wrong)
        raise InputError(wrong) from None


def _interrupted(cfg: DictConfig | None, resumes: bool) -> NoReturn:
    forgetful = cfg is not None and "finished" in cfg and cfg.finished is None
    if forgetful or not resumes:
        sys.stderr.write("interrupted; the same command begins anew\n")
        raise SystemExit(130) from None
    anew = cfg is not None and cfg.get("resume") is False
    how = ", with resume=true once it has begun to train," if anew else ""
    sys.stderr.write(f"interrupted; the same command{how} goes on from here\n")
    raise SystemExit(130) from None


def _quoted(argument: str) -> str:
    """``checkpoint=runs/model=lstm,seed=1`` is one path, named by a sweep, and not Hydra's grammar.

    So is ``checkpoint=runs/begin='runs/model=lstm',seed=1``, where an override named such a path.
    """
    whole = _PATH_WITH_KEYS.fullmatch(argument)
    if whole:
        return f"{whole[1]}='{whole[2]}'"
    whole = _PATH_WITH_QUOTES.fullmatch(argument)
    return f'{whole[1]}="{whole[2]}"' if whole else argument


def _require_one_option(argument: str) -> None:
    """Refuse ``sensors=[rod,crank]``: of options put on top of each other the last one alone would hold.

    Raises:
        InputError: several options of a group of which one is chosen.
    """
    listed = _LIST_OF_OPTIONS.fullmatch(argument)
    if listed and listed[1] != "experiment" and (CONFIGURATION / listed[1]).is_dir():
        group, options = listed[1], listed[2]
        own = "; sensors of your own: 'sensors.channels=[...]'" if group == "sensors" else ""
        raise InputError(
            f"{argument}: one option is chosen, not a list; one run for each: -m {group}={options}{own}"
        )


def _require_known(argument: str) -> None:
    """Refuse ``+seeed=1``: what no command reads would be accepted and passed over.

    Raises:
        InputError: a key that is added beside the command's own, and is no group of options.
    """
    added = _ADDED.fullmatch(argument)
    if added and not (CONFIGURATION / added[1]).is_dir():
        raise InputError(
            f"{argument}: + adds keys inside others, as in +sensor_chain.default.noise=0.01; a key of the "
            f"command's own is {added[1]}=..., without +, and --help shows them"
        )


def _thread_error(error: threading.ExceptHookArgs) -> None:
    # TensorBoard's writing thread stops at a full disk; the main thread learns of it and reports it.
    if not (isinstance(error.exc_value, OSError) and error.exc_value.errno in _FULL):
        threading.__excepthook__(error)


def _wrong_input(error: BaseException, cfg: DictConfig | None) -> str | None:
    """One line about the wrong input that caused an exception, if one did."""
    chain = list(_chain(error))
    for link in chain:  # the outermost InputError: it has added the file's name to what it caught
        if isinstance(link, InputError):
            return _with_full_keys(one_line(link), chain, cfg)
    for link in chain:
        if isinstance(link, HydraException | OmegaConfBaseException):
            return reworded(link, cfg)
        if isinstance(link, OSError) and link.errno is not None:
            remedy = "make room or choose another path" if link.errno in _FULL else "choose another path"
            return f"{link.filename or 'the output'}: {link.strerror}; {remedy}"
    return None


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _with_full_keys(message: str, chain: list[BaseException], cfg: DictConfig | None) -> str:
    """Replace "the key that ends in 'mass'" by ``mechanism.crank.mass``, where Hydra says its place."""
    places = [found[1] for link in chain if (found := re.search(r"full_key: (\S+)", str(link)))]
    if not places or cfg is None:
        return message
    return _UNKNOWN_KEY.sub(lambda end: set_at(cfg, f"{places[-1]}.{end[1]}"), message)
