"""Processes of the package's own commands: nothing that they started is left behind."""

import subprocess
import time
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from clearance.processes import end, quoted


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


@pytest.mark.parametrize("name", ["plain", "Eve's rig", 'a "b" c', "model=lstm,seed=1", "{y} [z]", "a\\'b"])
def test_a_path_reaches_a_command_as_it_is_whatever_signs_it_holds(name, tmp_path):
    given, parser = quoted(tmp_path / name), OverridesParser.create()
    assert parser.parse_override(f"folder={given}").value() == str(tmp_path / name)
    assert parser.parse_override(f"files=[{given},{given}]").value() == 2 * [str(tmp_path / name)]
