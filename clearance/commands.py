"""What every command shares: where its configuration lies, how it logs, how it reports a wrong input."""

import logging
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import hydra
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from clearance.errors import InputError

_HERE = Path(__file__).parent
CONFIGURATION = _HERE / "conf" if (_HERE / "conf").is_dir() else _HERE.parent / "conf"
"""The configuration folder: inside the package in a wheel, beside it in a checkout."""


def _user_error(error: BaseException | None) -> BaseException | None:
    """The wrong input at the root of an exception, if that is what it is."""
    while error is not None:
        if isinstance(error, InputError | OmegaConfBaseException):
            return error
        error = error.__cause__ or error.__context__
    return None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def command(name: str) -> Callable[[Callable[[DictConfig], Any]], Callable[[], Any]]:
    """Make a function of a configuration into a command with Hydra's command line.

    A wrong input ends the command with one line on standard error and exit code 2; so does a full disk.

    Args:
        name: of the file in ``conf/``.
    """

    def decorate(task: Callable[[DictConfig], Any]) -> Callable[[], Any]:
        @wraps(task)
        def guarded(cfg: DictConfig) -> Any:
            try:
                return task(cfg)
            except KeyboardInterrupt:
                sys.stderr.write("interrupted; the same command goes on from here\n")
                raise SystemExit(130) from None
            except Exception as error:
                wrong = _user_error(error)
                if wrong is None and isinstance(error, OSError) and error.errno == 28:
                    wrong = InputError(
                        f"no space left for {error.filename or 'the output'}: free some or change its folder"
                    )
                if wrong is None:
                    raise
                logging.getLogger(__name__).debug("wrong input", exc_info=error)
                sys.stderr.write(f"error: {_one_line(wrong)}\n")
                raise SystemExit(2) from None

        run = hydra.main(version_base="1.3", config_path=str(CONFIGURATION), config_name=name)(guarded)

        @wraps(task)
        def main() -> Any:
            try:
                return run()
            except SystemExit as stop:
                # Hydra reports a mistyped override by itself, with exit code 1
                raise SystemExit(2 if stop.code == 1 and sys.exc_info()[1] is None else stop.code) from None

        return main

    return decorate
