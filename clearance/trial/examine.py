"""Examine: one process a case, which sees the recordings alone; what was answered once is not asked again."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from clearance.errors import InputError
from clearance.processes import RUNNING, end, environment, quoted
from clearance.provenance import revision
from clearance.trial.case import KNOWN_FRAME
from clearance.trial.conceal import CASE, CASES, names_of
from clearance.whole_files import read_json, write_json

VERDICTS, VERDICT = "verdicts", "verdict.json"
CORRECTED = "corrected.yaml"
DIAGNOSIS = (sys.executable, "-m", "clearance.diagnose", "workers=1", "finished=null")
"""The program that is put to the test: on one thread, with nothing kept from another case."""
_DIAGNOSIS = "diagnosis.json"
_LOG, _LOCK = "output.txt", ".asked"
_LARGEST = 1e100  # that a number of an answer may be


@dataclass(frozen=True)
class Examiner:
    """How a case is put to the tool.

    Attributes:
        program: command line to which the recordings and what is known are added.
        arguments: more of it, at the end.
        verdicts: folder of the answers within that of the trial.
        time_limit: of one case [s].
        retry: whether cases that failed are tried again.
    """

    program: Sequence[str]
    arguments: Sequence[str] = ()
    verdicts: str = VERDICTS
    time_limit: float = 600.0
    retry: bool = False

    def asked(self) -> dict[str, Any]:
        """What is put to the test now, and how: a result says it of each case."""
        words = ["python" if word == sys.executable else word for word in self.program]
        return {
            "program": " ".join([*words, *self.arguments]), "time_limit": self.time_limit,
            "revision": revision(),
        }  # fmt: skip

    def examine(
        self, folder: Path, parallel: int, report: Callable[[str], None], shard: tuple[int, int] = (1, 1)
    ) -> None:
        """Put every case to the tool that has no outcome yet, and that no other process is asking.

        Args:
            folder: of the trial.
            parallel: processes at a time.
            report: called with progress.
            shard: (k, n): every n-th case beginning with the k-th.

        Raises:
            InputError: if one is left after the reveal, when the truth may be known.
        """
        names = names_of(folder)[shard[0] - 1 :: shard[1]]
        left = [name for name in names if not self._done(folder / self.verdicts / name)]
        if left and hashes_of(folder, self.verdicts).exists():
            raise InputError(
                f"{folder / self.verdicts / left[0]} would be asked again after the reveal; set "
                "retry=false, or choose another folder"
            )
        report(f"{len(names) - len(left)} of {len(names)} cases have a verdict")
        running, stopped = set[subprocess.Popen[bytes]](), threading.Event()
        pool = ThreadPoolExecutor(parallel)
        try:
            tasks = [pool.submit(self._ask, folder, name, running, stopped, report) for name in left]
            for task in tasks:
                task.result()
        finally:
            stopped.set()  # what is ended here has failed at nothing, and is asked again another time
            pool.shutdown(wait=False, cancel_futures=True)
            for process in list(running):
                end(process)

    def _done(self, place: Path) -> bool:
        if not (place / VERDICT).exists():
            return False
        return not (self.retry and read_json(place / VERDICT, "folder")["failure"])

    def command(self, folder: Path, name: str) -> list[str]:
        """The command line for a case."""
        case, told = folder / CASES / name, read_json(folder / CASES / name / CASE, "folder")
        recordings = ",".join(map(quoted, sorted(case.glob("*.parquet"))))
        limits = told.get("tolerances", {})
        known = ["frame=flexible", *(f"frame.{key}={value}" for key, value in KNOWN_FRAME.items())]
        return [
            *self.program, f"recordings=[{recordings}]", f"joint={told['joint']}",
            *(known if told["known_frame"] else []), f"without=[{','.join(told['without'])}]",
            *([f"tolerances={{{', '.join(f'{k}: {v}' for k, v in limits.items())}}}"] if limits else []),
            f"hydra.run.dir={quoted(folder / self.verdicts / name)}", *self.arguments,
        ]  # fmt: skip

    def _ask(
        self, folder: Path, name: str, running: set[subprocess.Popen[bytes]], stopped: threading.Event,
        report: Callable[[str], None],
    ) -> None:  # fmt: skip
        place = folder / self.verdicts / name
        place.mkdir(parents=True, exist_ok=True)
        try:
            with FileLock(place / _LOCK, timeout=0):
                if not self._done(place):
                    self._ask_alone(folder, name, running, stopped, report)
        except Timeout:
            report(f"{name}: another process is asking")

    def _ask_alone(
        self, folder: Path, name: str, running: set[subprocess.Popen[bytes]], stopped: threading.Event,
        report: Callable[[str], None],
    ) -> None:  # fmt: skip
        place = folder / self.verdicts / name
        if not _is_free(place, stopped, lambda: report(f"{name}: waits for the process of a killed trial")):
            return
        tries = _tries(place / VERDICT)
        for outdated in (_DIAGNOSIS, CORRECTED):
            (place / outdated).unlink(missing_ok=True)
        asked, began = self.asked(), time.monotonic()
        with (place / _LOG).open("wb") as log:
            process = subprocess.Popen(
                self.command(folder, name), stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                env=environment(OMP_NUM_THREADS="1", NUMBA_NUM_THREADS="1"), start_new_session=True,
            )  # fmt: skip
        running.add(process)
        try:
            if stopped.is_set():  # begun just as the others were ended
                return
            process.wait(self.time_limit)
            failure, diagnosis = _answer(process.returncode, place)
        except subprocess.TimeoutExpired:
            failure, diagnosis = f"no verdict within {self.time_limit:g} s", None
        finally:
            end(process)
            running.discard(process)
        if stopped.is_set():
            return
        seconds = round(time.monotonic() - began, 1)
        # A copy, whole in one file: what a process of an earlier, killed trial still writes cannot change it.
        machine = place / CORRECTED
        corrected = machine.read_text(encoding="utf-8") if diagnosis and machine.exists() else None
        write_json(
            place / VERDICT,
            {
                "seconds": seconds,
                "tries": tries + 1,
                "failure": failure,
                "diagnosis": diagnosis,
                "corrected": corrected,
                "asked": asked,
            },
        )
        report(f"{name}: {diagnosis['verdict'] if diagnosis else failure} ({seconds:.0f} s)")


def _is_free(place: Path, stopped: threading.Event, wait: Callable[[], None]) -> bool:
    """Wait until no process of an earlier, killed trial writes there; false if this one is stopped before.

    Beside it a diagnosis would refuse to run, and count as failed.
    """
    told = False
    while True:
        try:
            with FileLock(place / RUNNING, timeout=0):
                return True
        except Timeout:
            if not told:
                wait()
            told = True
            if stopped.wait(1.0):
                return False


def hashes_of(folder: Path, verdicts: str) -> Path:
    """Where the hash of all verdicts of one program lies from the reveal on."""
    return folder / f"{verdicts}.json"


def _tries(verdict: Path) -> int:
    """How often a case was asked before; once where a file of an older version does not say."""
    return int(read_json(verdict, "folder").get("tries", 1)) if verdict.exists() else 0


def _answer(code: int, place: Path) -> tuple[str | None, dict[str, Any] | None]:
    """Why there is no diagnosis, or ``None``; the diagnosis, or ``None``."""
    if code != 0:
        here = f"{place.resolve().parents[1]}/"  # is published without where it lay
        text = (place / _LOG).read_text(encoding="utf-8", errors="replace").replace(here, "")
        lines = text.strip().splitlines()
        return f"exit code {code}: {lines[-1][:300] if lines else 'no output'}", None
    try:
        text = (place / _DIAGNOSIS).read_text(encoding="utf-8")
        content: Any = json.loads(text, parse_constant=_refuse)
    except (OSError, ValueError) as error:
        return f"no readable {_DIAGNOSIS} ({error})", None
    wrong = _unlike_a_diagnosis(content)
    return (f"{_DIAGNOSIS} {wrong}", None) if wrong else (None, content)


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")


def _unlike_a_diagnosis(content: Any) -> str | None:
    """What the score could not read: found here it is one case's failure, after the reveal the trial's."""
    if not isinstance(content, dict) or not isinstance(content.get("verdict"), str):
        return "has no verdict"
    effects, fit, clearance = (content.get(key) for key in ("effects", "fit", "clearance"))
    held = fit.get("held_out") if isinstance(fit, dict) else None
    if not isinstance(held, dict) or not _numbers_or_null(held, "before", "after", "floor"):
        return "has no fit.held_out whose before, after and floor are numbers or null"
    if held.get("after") is not None and not (held.get("floor") or 0.0) > 0.0:
        return "has no fit.held_out.floor above 0 beside fit.held_out.after"
    shares = held.get("shares", {})
    if not isinstance(shares, dict) or not all(map(_is_number, shares.values())):
        return "has fit.held_out.shares that are no mapping to numbers"
    if not _numbers_or_null(content, "peak_memory_mib"):
        return "has a peak_memory_mib that is no number"
    if not isinstance(clearance, dict) or "after_m" not in clearance:
        return "has no clearance.after_m, a number or null"
    if not _numbers_or_null(clearance, "before_m", "after_m", "low_m", "high_m"):
        return "has a clearance of which before_m, after_m, low_m and high_m are not all numbers or null"
    if not isinstance(effects, list) or not all(map(_is_effect, effects)):
        return "has no list of effects with name, kind and value, low and high of each of their parameters"
    others = content.get("equivalent") or []
    if not (isinstance(others, list) and all(_is_list_of(str, names) for names in others)):
        return "has an equivalent that is no list of lists of names"
    place = content.get("mismatch") or {}
    if not isinstance(place, dict) or not _numbers_or_null(place, "score"):
        return "has a mismatch that is no mapping, or whose score is no number"
    return None if _is_curve(content.get("free_form")) else "has a free_form without argument and table"


def _is_effect(one: Any) -> bool:
    if not isinstance(one, dict) or not {"name", "kind", "parameters"} <= set(one):
        return False
    if not isinstance(one["name"], str) or not isinstance(one.get("channel"), str | None):
        return False
    given = one["parameters"].values() if isinstance(one["parameters"], dict) else [None]
    return all(
        isinstance(p, dict) and p.get("value") is not None and _numbers_or_null(p, "value", "low", "high")
        for p in given
    )


def _is_curve(one: Any) -> bool:
    if one is None:
        return True
    if not isinstance(one, dict) or not isinstance(one.get("argument"), str):
        return False
    table, clocks = one.get("table"), one.get("clocks")
    if not _numbers_or_null(one, "period") or not (clocks is None or _are_numbers(clocks)):
        return False
    return isinstance(table, list) and all(_are_numbers(row) and len(row) == 2 for row in table)


def _is_list_of(kind: Any, values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(value, kind) for value in values)


def _are_numbers(values: Any) -> bool:
    return isinstance(values, list) and all(map(_is_number, values))


def _is_number(value: Any) -> bool:
    """One whose square a float holds: JSON's may have any number of digits."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _numbers_or_null(given: dict[str, Any], *keys: str) -> bool:
    return all(given.get(key) is None or _is_number(given[key]) for key in keys)
