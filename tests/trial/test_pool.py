"""Trials added up: every case once, each with the name of its trial."""

import json

import pytest

from clearance.errors import InputError
from clearance.evaluation.results import marks
from clearance.trial.pool import pool
from clearance.trial.reveal import reveal
from clearance.trial.score import score_case
from clearance.trial.summary import summarise
from clearance.whole_files import write_json
from tests.command_line import call
from tests.trial.conftest import copied


@pytest.fixture(scope="module")
def revealed(concealed, tmp_path_factory):
    """What is known of a trial as a whole, and a row a case."""
    with copied(concealed, tmp_path_factory.mktemp("pool") / "trial") as trial:
        trial.examine()
        facts, cases = reveal(trial.folder, trial.sealed)
        return facts, [score_case(one) for one in cases]


@pytest.fixture
def published(revealed, tmp_path):
    """Results of two trials; the second is the first's with another seed and one case less."""
    facts, rows = revealed
    result = {"date": "2026-01-01"} | facts | summarise(rows) | {"rows": rows}
    other = facts | {"seed": 12, "commitment": "0" * 64, "scope": facts["scope"] | {"cases": 3}}
    paths = [tmp_path / "trial-11.json", tmp_path / "trial-12.json"]
    write_json(paths[0], result)
    write_json(paths[1], {"date": "2026-01-02"} | other | summarise(rows[:3]) | {"rows": rows[:3]})
    return paths


def test_cases_add_up_under_the_names_of_their_trials(published):
    facts, rows = pool(published)
    assert [one["seed"] for one in facts["trials"]] == [11, 12]
    assert len(rows) == len({row["name"] for row in rows}) == 7
    assert rows[-1]["name"] == "12/case_0003"
    first, second = (json.loads(path.read_text()) for path in published)
    for score in ("detected", "body", "false_alarms", "held_out_at_floor"):
        total = summarise(rows)[score]
        assert (total["count"], total["of"]) == tuple(
            first[score][key] + second[score][key] for key in ("count", "of")
        ), score


def test_rows_of_older_versions_are_refused(published):
    result = json.loads(published[1].read_text())
    del result["rows"][1]["rightly"]
    published[1].write_text(json.dumps(result))
    with pytest.raises(InputError, match=r"case_0002 does not say what was rightly named.*leave it out"):
        pool(published)


def test_one_command_makes_result_table_and_pictures(published, monkeypatch, capfd, tmp_path):
    (tmp_path / "page.md").write_text("\n".join(marks("trial", "trial")))
    settings = (
        "stage=pool", f"pooled=[{','.join(map(str, published))}]", f"results={tmp_path}/pooled.json",
        f"pictures={tmp_path}/pictures", f"readme={tmp_path}/page.md", f"hydra.run.dir={tmp_path}/run",
    )  # fmt: skip
    code, error = call(monkeypatch, capfd, "trial.__main__", *settings)
    assert (code, error) == (0, "")
    result = json.loads((tmp_path / "pooled.json").read_text())
    assert result["cases"] == 7
    assert "rows" not in result  # each trial's own file has its own
    count = f"{result['body']['count']} of {result['body']['of']}"
    assert f"| body right | {count} " in (tmp_path / "page.md").read_text()
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {
        "power.png", "power_by_effect.png", "confusion.png", "estimates.png", "curves.png"
    }  # fmt: skip


def test_what_cannot_be_added_up_is_refused(published):
    first, second = published
    with pytest.raises(InputError, match="nothing to add up"):
        pool([])
    with pytest.raises(InputError, match="the trial of seed 11 comes twice"):
        pool([first, second, first])
    content = json.loads(second.read_text())
    write_json(second, content | {"seed": 11})  # the same cases under another seal
    with pytest.raises(InputError, match="the trial of seed 11 comes twice"):
        pool(published)
    write_json(second, content | {"scope": content["scope"] | {"encoder": 0.1}})
    with pytest.raises(InputError, match="drawn in another way"):
        pool(published)
    another = [one | {"time_limit": 60.0} for one in content["asked"]]
    write_json(second, content | {"asked": another})
    with pytest.raises(InputError, match=r"another program, or with another limit of time"):
        pool(published)
    write_json(second, {key: value for key, value in content.items() if key != "rows"})
    with pytest.raises(InputError, match="has no rows"):
        pool(published)
    write_json(second, {"trials": [], "cases": 7})
    with pytest.raises(InputError, match="is a sum of trials already"):
        pool(published)
