"""One headless browser for all tests of the report."""

import pytest

from clearance.diagnosis.report import write_report
from tests.diagnosis.report.browser import Browser, find_browser


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    program = find_browser()
    if program is None:
        pytest.skip("no browser of the Chromium family is installed")
    found = Browser(program, tmp_path_factory.mktemp("profile"))
    yield found
    found.close()


@pytest.fixture
def show(browser, tmp_path):
    """Write a report, open it, and insist that it draws itself without a complaint or a request."""

    def opened(diagnosis, evidence, **window):
        page = tmp_path / "report.html"
        write_report(page, diagnosis, evidence)
        browser.open(page, **window)
        assert browser.complaints == []
        assert [url for url in browser.requests if not url.startswith("data:")] == [page.as_uri()]
        if window.get("script", True):
            drawn = browser.run(
                "[{...document.documentElement.dataset}, document.documentElement.scrollWidth]"
            )
            assert drawn[0] == {"drawn": ""}
            assert drawn[1] <= window.get("width", 1280)
        return browser

    return opened
