"""The pages: links lead somewhere, and what can be named is what the table says."""

import re

import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from tests.command_line import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def anchors(text):
    titles = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_file_and_a_heading(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if target.startswith("http"):
            continue
        name, _, heading = target.partition("#")
        file = (page.parent / name) if name else page
        assert file.exists(), target
        assert not heading or heading in anchors(file.read_text()), target


def test_the_table_names_every_effect_with_its_parameters():
    rows = {
        row.split("`")[1]: row
        for row in (ROOT / "docs/effects.md").read_text().splitlines()
        if row.startswith("| `")
    }
    effects = {effect.name: effect for effect in load_effects()}
    assert rows.keys() == effects.keys()
    for name, effect in effects.items():
        listed = rows[name].split("|")[3]
        assert [part.split("[")[0].strip() for part in listed.split(",")] == list(effect.parameters)


def test_every_page_is_reached_from_the_readme():
    text = PAGES[0].read_text()
    assert all(f"docs/{page.name}" in text for page in PAGES[1:])
