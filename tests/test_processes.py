"""Processes of the package's own commands: nothing that they started is left behind."""

import subprocess
import time
from pathlib import Path

import pytest

from clearance.processes import end


def _lives(number):
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"  # of which nobody has asked yet how it ended


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="asks Linux's /proc")
@pytest.mark.parametrize("leaves", [True, False])
def test_what_a_process_started_ends_with_it_though_it_ended_before(leaves):
    script = "sleep 60 >/dev/null & echo $!" + ("" if leaves else "; wait")
    process = subprocess.Popen(
        ["sh", "-c", script], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    with process.stdout as said:
        child = int(said.readline())
    if leaves:
        process.wait()
    assert _lives(child)
    end(process)
    end(process)  # nothing is left to end
    for _ in range(50):
        if not _lives(child):
            break
        time.sleep(0.1)
    assert not _lives(child)
    assert process.returncode is not None
