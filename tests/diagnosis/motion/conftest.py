"""What tests of motion share."""

import signal

import pytest


@pytest.fixture
def handled():
    """Returns what sets a signal's handler for a test: started in the background some are ignored."""
    before = {}

    def put(number, handler):
        before[number] = signal.signal(number, handler)
        return handler

    yield put
    for number, handler in before.items():
        signal.signal(number, handler)
