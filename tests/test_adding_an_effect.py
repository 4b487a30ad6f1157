"""The page on adding an effect, done as it says, in a copy of the project."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_line import environment

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/adding-an-effect.md").read_text()
LAW, ENTRY, EFFECT, SCRIPT, TABLE = re.findall(r"```(?:python|yaml)\n(.*?)```", PAGE, re.S)
(OUTPUT,) = re.findall(r"```\n(The slider.*?)```", PAGE, re.S)


@pytest.fixture
def project(tmp_path):
    for part in ("clearance", "conf"):
        shutil.copytree(ROOT / part, tmp_path / part)  # what is compiled, too: files keep their times
    return tmp_path


def insert(path, after, new):
    """Put lines after the only one that holds a text."""
    lines = path.read_text().splitlines()
    (place,) = [i for i, line in enumerate(lines) if after in line]
    lines[place + 1 : place + 1] = new
    path.write_text("\n".join(lines))


def printed(project, script):
    (project / "tried.py").write_text(script)
    done = subprocess.run(
        [sys.executable, "tried.py"], cwd=project, env=environment() | {"PYTHONPATH": str(project)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_law_that_fills_a_table_takes_two_files(project):
    (project / "clearance/mechanism/tabulated_drag.py").write_text(TABLE)
    effect = EFFECT.replace("quadratic_drag", "tabulated_drag").replace("process", "force")
    effect = effect.replace("load.QuadraticDrag", "tabulated_drag.TabulatedDrag")
    (project / "conf/effect/tabulated_drag.yaml").write_text(effect)
    output = printed(project, SCRIPT.replace("quadratic_drag", "tabulated_drag"))
    (power,) = re.findall(r"drive (\S+) W", output)
    assert f"then gives {power} W from the drive" in PAGE
    assert output.splitlines()[0] == OUTPUT.splitlines()[0]


@pytest.mark.slow  # every kernel is compiled anew
def test_a_formula_of_its_own_takes_its_law_its_entry_its_call_and_the_effect(project):
    law = project / "clearance/mechanism/load.py"
    text = law.read_text().replace("from clearance.lanes import ", "from clearance.lanes import absolute, ")
    law.write_text(f"{text}\n\n{LAW.partition(chr(10))[2]}")
    entry, _, call = ENTRY.partition("# clearance/simulation/equations.py")
    insert(project / "clearance/mechanism/parameters.py", "PROCESS_END", entry.splitlines()[1:])
    _, imported, *called = call.splitlines()
    equations = project / "clearance/simulation/equations.py"
    insert(equations, "import process_force, spring_force", [imported])
    insert(equations, "+ process_force(", called)
    (project / "conf/effect/quadratic_drag.yaml").write_text(EFFECT)
    output = printed(project, SCRIPT)
    assert output.splitlines()[0] == OUTPUT.splitlines()[0]
    shown, told = (re.findall(r"(\d+\.?\d*) (m/s|N m|W)", text) for text in (output, OUTPUT))
    assert [unit for _, unit in shown] == [unit for _, unit in told] == ["m/s", "N m", "W", "W"]
    assert [float(n) for n, _ in shown] == pytest.approx([float(n) for n, _ in told], rel=0.01)
    assert float(shown[2][0]) == pytest.approx(float(shown[3][0]), rel=1e-3)  # the balance of power
