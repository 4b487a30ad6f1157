"""A small concealed trial: one null, two effects, one unknown force; short recordings, one a case."""

import json
import shutil
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from clearance.trial.conceal import conceal
from clearance.trial.draw import Scope
from clearance.trial.examine import Examiner
from clearance.trial.seal import TRUTH, lock, unlock

TOOL = Path(__file__).with_name("tool.py")
SCOPE = Scope(
    cases=4, shares={"none": 1, "effect": 2, "outside": 1}, seconds=(0.2, 0.2), recordings=1,
    noise=((0.01, 1.0),), sensors={"all": 1.0},
)  # fmt: skip


class Trial:
    """A concealed trial and the stand-in that is asked about it."""

    def __init__(self, home):
        self.folder, self.sealed, self.answers = home / "public", home / "sealed", home / "answers.json"
        self.answers.write_text("{}")

    def examine(self, **settings):
        program = [sys.executable, str(TOOL), str(self.answers)]
        Examiner(program, **settings).examine(self.folder, 2, lambda line: None)

    def answer(self, answers):
        self.answers.write_text(json.dumps(answers))

    def asked(self):
        log = Path(f"{self.answers}.log")
        return log.read_text().split() if log.exists() else []

    def truth(self):
        unlock(self.sealed)
        content = json.loads((self.sealed / TRUTH).read_text())
        lock(self.sealed)
        return content


@pytest.fixture(scope="session")
def concealed(tmp_path_factory):
    home = tmp_path_factory.mktemp("trial")
    conceal(SCOPE, 11, home / "public", home / "sealed", 1, lambda line: None)
    unlock(home / "sealed")  # so that it can be copied
    return home


@contextmanager
def copied(concealed, home):
    """A fresh copy of a concealed trial; it can be deleted afterwards."""
    shutil.copytree(concealed, home)
    lock(home / "sealed")
    try:
        yield Trial(home)
    finally:
        unlock(home / "sealed")


@pytest.fixture
def trial(concealed, tmp_path):
    """A fresh copy of the concealed trial."""
    with copied(concealed, tmp_path / "trial") as trial:
        yield trial
