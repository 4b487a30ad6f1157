"""The GPU's simulator is the CPU's: in Numba's simulator of CUDA, in CUDA's own compiler, and on a GPU."""

import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.simulation.batch import run_batch
from clearance.simulation.gpu import batch as gpu
from clearance.simulation.layout import Result
from clearance.simulation.trajectory import simulate_trajectory
from tests.command_line import ROOT, call, environment
from tests.simulation.gpu_cases import EULER, MACHINES, SAMPLING, STATES, simulate_cases

# Of a signal's largest value. Positions are rounded by 1e-17 m, by which a contact of some 1e12 N/m^1.5
# changes by 1e-8 N, 1e-7 m/s^2 beside hundreds.
ROUNDING = 1e-8


def python(module, *arguments, **variables):
    return subprocess.run(
        [sys.executable, "-m", module, *map(str, arguments)],
        cwd=ROOT, env={**environment(), **variables}, capture_output=True, text=True, timeout=600, check=True,
    )  # fmt: skip


def assert_same(found, expected):
    assert found.keys() == expected.keys()
    for name, signals in expected.items():
        if signals.ndim == 0:
            assert str(found[name]) == str(signals)
            continue
        assert found[name].shape == signals.shape
        largest = np.abs(signals).max(axis=0)
        difference = np.abs(found[name] - signals).max(axis=0)
        assert (difference <= ROUNDING * largest).all(), f"{name}: {difference / largest}"


@pytest.fixture(scope="module")
def on_cpu():
    return simulate_cases(run_batch, any_laws=True)


def test_cases_touch_and_fail(on_cpu):
    assert "non-finite" in str(on_cpu["not_finite 0"])
    for index, force in ((0, Result.NORMAL_FORCE_C), (1, Result.NORMAL_FORCE_B), (3, Result.NORMAL_FORCE_C)):
        path = simulate_trajectory(MACHINES[index], EULER, SAMPLING.duration, state=STATES[index])
        assert path.results[:, force].max() > 1.0  # N


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_kernel_in_numbas_simulator_agrees_with_the_cpu(on_cpu, tmp_path):
    """The same source as Python, thread by thread: what of lanes is replaced, how memory is laid out."""
    python("tests.simulation.gpu_cases", tmp_path / "found.npz", NUMBA_ENABLE_CUDASIM="1")
    with np.load(tmp_path / "found.npz") as found:
        assert_same(dict(found), on_cpu)


@pytest.mark.slow
@pytest.mark.skipif(
    find_spec("numba_cuda") is None, reason="numba-cuda is not installed: pip install '.[cuda]'"
)
def test_cudas_compiler_takes_the_kernel():
    code = python("tests.simulation.gpu_compilation").stdout
    assert code.count(".entry") == 1
    assert "call.uni" not in code  # all is inlined, and laws that are not chosen are gone
    assert "div.rn.f64" in code
    assert "fma.rn.f64" in code
    assert ".f32" not in code
    assert ".approx" not in code  # rounded as on the CPU


@pytest.mark.gpu
@pytest.mark.skipif(find_spec("numba_cuda") is None, reason="pip install '.[cuda]'")
def test_gpu_agrees_with_the_cpu(on_cpu):
    try:
        gpu.require_gpu()
    except InputError as missing:
        pytest.skip(str(missing))
    assert_same(simulate_cases(gpu.run_batch_on_gpu), on_cpu)


@pytest.mark.parametrize("name", ["simulate", "bench"])
def test_without_numba_cuda_the_commands_say_what_to_install(name, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(gpu, "find_spec", lambda _: None)
    asked, other = {
        "simulate": (["device=cuda", "dataset=data"], "change the key that ends in 'device' to cpu"),
        "bench": (["suite=gpu"], "choose suite=simulator"),
    }[name]
    code, error = call(monkeypatch, capfd, name, *asked)
    assert code == 2
    assert other in error
    assert "pip install '.[cuda]'" in error
    assert not (tmp_path / "data").exists()


def test_another_device_is_refused(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    code, error = call(monkeypatch, capfd, "simulate", "device=tpu")
    assert code == 2
    assert "device = 'tpu' is not one of cpu, cuda" in error
