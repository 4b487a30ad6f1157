"""What every command shares: where its configuration lies, how it logs, how it reports a wrong input."""

import errno
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import hydra
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from clearance.errors import InputError

_HERE = Path(__file__).parent
CONFIGURATION = _HERE / "conf" if (_HERE / "conf").is_dir() else _HERE.parent / "conf"
"""The configuration folder: inside the package in a wheel, beside it in a checkout."""

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_BACKGROUND = re.compile(r"Config search path:.*|\s*object_type=.*|See https://\S+.*")


def command(name: str) -> Callable[[Callable[[DictConfig], Any]], Callable[[], Any]]:
    """Make a function of a configuration into a command with Hydra's command line.

    A wrong input ends the command with one line on standard error and exit code 2; so does a full disk.

    Args:
        name: of the file in ``conf/``.
    """

    def decorate(task: Callable[[DictConfig], Any]) -> Callable[[], Any]:
        @wraps(task)
        def guarded(cfg: DictConfig) -> Any:
            with _reported():  # here too: Hydra adds a line of its own to what leaves a job
                return task(cfg)

        run = hydra.main(version_base="1.3", config_path=str(CONFIGURATION), config_name=name)(guarded)

        @wraps(task)
        def main() -> Any:
            os.environ["HYDRA_FULL_ERROR"] = "1"  # let errors through, instead of Hydra's own report of them
            with _reported():
                return run()

        return main

    return decorate


@contextmanager
def _reported() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        sys.stderr.write("interrupted; the same command goes on from here\n")
        raise SystemExit(130) from None
    except Exception as error:
        wrong = _wrong_input(error)
        if wrong is None:
            raise
        logging.getLogger(__name__).debug("wrong input", exc_info=error)
        sys.stderr.write(f"error: {wrong}\n")
        raise SystemExit(2) from None


def _wrong_input(error: BaseException) -> str | None:
    """One line about the wrong input at the root of an exception, if that is what it is."""
    chain = list(_chain(error))
    # The innermost knows best which key is meant.
    for kind in (InputError, OmegaConfBaseException, HydraException):
        found = [link for link in chain if isinstance(link, kind)]
        if found:
            return _BACKGROUND.sub("", " ".join(str(found[-1]).split())).strip()
    for link in chain:
        if isinstance(link, OSError) and link.errno in _FULL:
            place = link.filename or "the output"
            return f"{place}: not written ({link.strerror}); make room or choose another folder"
    return None


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
