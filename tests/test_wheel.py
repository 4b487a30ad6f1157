"""The wheel holds the package and its configuration, and works from any folder."""

import subprocess
import sys
import zipfile

import pytest

from tests.command_line import ROOT, command, environment


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", str(folder), str(ROOT)]
    done = subprocess.run(build, capture_output=True, text=True)
    if "No matching distribution" in done.stderr:
        pytest.skip("the build tool cannot be fetched here")
    assert done.returncode == 0, done.stderr
    return next(folder.glob("clearance-*.whl"))


def test_the_wheel_holds_every_file_of_the_package_and_of_the_configuration(wheel):
    inside = set(zipfile.ZipFile(wheel).namelist())
    own = [path for path in (ROOT / "clearance").rglob("*.*") if path.suffix not in (".pyc", ".nbi", ".nbc")]
    modules = {str(path.relative_to(ROOT)) for path in own if path.is_file()}
    files = {f"clearance/{path.relative_to(ROOT)}" for path in (ROOT / "conf").rglob("*.yaml")}
    assert modules | files <= inside
    assert not [name for name in inside if name.startswith(("tests", "outputs", "conf"))]


@pytest.mark.slow  # compiles the simulator anew
def test_a_command_of_the_wheel_runs_elsewhere(wheel, tmp_path):
    site = tmp_path / "site"
    install = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--target",
        str(site),
        str(wheel),
    ]
    subprocess.run(install, check=True, capture_output=True)
    (tmp_path / "work").mkdir()
    short = ("runs=2", "campaign.duration=0.3", "campaign.record_start=0.1")
    inside = {"cwd": tmp_path / "work", "env": {**environment(), "PYTHONPATH": str(site)}}
    where = [sys.executable, "-c", "import clearance.commands as c; print(c.__file__, c.CONFIGURATION)"]
    found = subprocess.run(where, **inside, check=True, capture_output=True, text=True).stdout.split()
    assert all(path.startswith(str(site)) for path in found)
    done = subprocess.run(command("simulate", *short), **inside, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "work/outputs/datasets").glob("*/signals/c/*/0/0"))) == 2
