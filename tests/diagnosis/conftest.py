"""One headless browser for all tests of the report."""

import pytest

from tests.diagnosis.report.browser import Browser, find_browser


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    program = find_browser()
    if program is None:
        pytest.skip("no browser of the Chromium family is installed")
    found = Browser(program, tmp_path_factory.mktemp("profile"))
    yield found
    found.close()
