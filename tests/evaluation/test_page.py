"""Results beside a page: nothing is written unless the tables have a place in it."""

import json

import pytest

from clearance.errors import InputError
from clearance.evaluation.results import markdown, marks, put_between_marks
from tests.command_line import call


@pytest.mark.parametrize("page", [None, "no marks", "swapped"])
def test_a_page_without_a_place_for_the_tables_leaves_the_results_as_they_are(
    refused, trained, tmp_path, page
):
    words = "readme = README.md: not a readable page .*; change readme$"
    if page is not None:
        begin, end = marks("results")
        (tmp_path / "README.md").write_text(page if page == "no marks" else f"{end}\n{begin}\n")
        words = "readme lacks the lines '<!-- results: .* in this order"
    refused("evaluate", words, f"runs='{trained}/run'", "results=results", "readme=README.md")
    assert not (tmp_path / "results").exists()


def test_a_page_shows_the_results_that_are_written(trained, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    begin, end = marks("results")
    (tmp_path / "README.md").write_text(f"{begin}\nformerly\n{end}\n")
    where = (f"runs='{trained}/run'", "results=results", "readme=README.md")
    assert call(monkeypatch, capfd, "evaluate", *where)[0] == 0
    (row,) = json.loads((tmp_path / "results/trainings.json").read_text())
    assert (tmp_path / "README.md").read_text() == f"{begin}\n{markdown([row])}{end}\n"


def test_a_mark_that_ends_before_it_begins_is_named():
    begin, end = marks("bench")
    with pytest.raises(InputError, match="in this order"):
        put_between_marks(f"{end}\n{begin}\n", "bench", "")
    text = put_between_marks(f"{end}\n{begin}\n{end}\n", "bench", "table\n")
    assert text == f"{end}\n{begin}\ntable\n{end}\n"
