"""The benchmark of the GPU without one: what it counts and times; the numbers depend on the machine."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from numba import cuda

from clearance.benchmark import gpu
from clearance.simulation.failure import Failure
from tests.test_bench import SMALL

FAILURE = Failure(0.01, "contact", {})
SLOW = 0.5  # s, the processor's first runs


def simulator(failing, scale=1.0, slow=0.0):
    """A batch whose signals are 1, 2, 3, ... times ``scale``; it takes long the first time."""
    delays = [slow]

    def batch(machines, integrator, sampling, sink, workers):
        time.sleep(delays.pop() if delays else 0.0)
        signals = scale * np.arange(1.0, 13.0).reshape(4, 3)
        for run in range(len(machines)):
            sink(run, FAILURE if run in failing else signals)

    return batch


@pytest.fixture
def measured(monkeypatch):
    """Call the benchmark with runs that fail on the processor and on the GPU."""

    def call(on_processor, on_gpu):
        monkeypatch.setattr(gpu, "require_gpu", lambda *_: None)
        monkeypatch.setattr(cuda, "get_current_device", lambda: SimpleNamespace(name="none"))
        monkeypatch.setattr(gpu, "run_batch", simulator(on_processor, slow=SLOW))
        monkeypatch.setattr(gpu, "run_batch_on_gpu", simulator(on_gpu, scale=1.0 + 1e-9))
        return gpu.measure_gpu(SMALL, 2, 32)

    return call


def test_runs_that_failed_are_left_out_and_counted(measured):
    report = measured({3, 7}, {7, 11})
    assert report["left_out"] == 3
    assert report["difference"] == pytest.approx(1e-9, rel=1e-6)
    assert [row["failed"] for row in report["devices"]] == [2, 2]
    assert "3 of them failed on either" in list(gpu.lines(report))[-1]


def test_where_all_fail_nothing_is_compared(measured):
    report = measured(set(range(200)), set())
    assert (report["left_out"], report["difference"]) == (200, None)
    assert not any("differ by" in line for line in gpu.lines(report))


def test_the_processors_first_runs_are_not_counted_as_the_gpus(measured):
    assert measured(set(), set())["first_on_gpu_s"] < SLOW
