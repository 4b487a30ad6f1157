"""The memory that a process is said to have taken is its own."""

import subprocess
import sys

import numpy as np
import pytest

from tests.command_line import ROOT, environment


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process inherits the record of its parent")
def test_a_program_is_not_charged_with_what_held_the_one_that_started_it():
    held = np.ones(2**26)  # 512 MiB
    code = "from clearance.provenance import peak_memory; b = bytearray(2**26); print(peak_memory())"
    said = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment(), capture_output=True, text=True, check=True
    )
    assert 64.0 < float(said.stdout) < 400.0 < held.nbytes / 2**20
