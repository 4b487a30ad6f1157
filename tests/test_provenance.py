"""What made a result: the memory that it took is its own, the commit that of the sources that run."""

import subprocess
import sys

import numpy as np
import pytest

from clearance import provenance
from tests.command_line import ROOT, environment


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process inherits the record of its parent")
def test_a_program_is_not_charged_with_what_held_the_one_that_started_it():
    held = np.ones(2**26)  # 512 MiB
    code = "from clearance.provenance import peak_memory; b = bytearray(2**26); print(peak_memory())"
    said = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment(), capture_output=True, text=True, check=True
    )
    assert 64.0 < float(said.stdout) < 400.0 < held.nbytes / 2**20


def test_a_result_says_from_which_commit_it_is_and_whether_anything_was_changed_since(monkeypatch, tmp_path):
    source = tmp_path / "clearance" / "provenance.py"
    source.parent.mkdir()
    source.write_text("")
    monkeypatch.setattr(provenance, "__file__", str(source))
    assert provenance.revision() is None
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "first"]):
        subprocess.run([*git, *words], check=True)
    head = subprocess.run(
        [*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True
    ).stdout.strip()
    (tmp_path / "notes.txt").write_text("not of the sources")
    assert provenance.revision() == head
    source.write_text("changed")
    assert provenance.revision() == f"{head}, changed"
