"""Reports that are written and opened."""

import pytest

from clearance.diagnosis.report import write_report


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
