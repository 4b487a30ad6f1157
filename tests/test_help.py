"""``--help``: what a command's file says of itself, key by key, and only what the command can do."""

import pytest

from clearance.configuration import CONFIGURATION
from clearance.diagnose import UNUSED
from clearance.help import help_text

COMMANDS = sorted(path.stem for path in CONFIGURATION.glob("*.yaml") if path.stem != "machine")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_says_what_it_is_for_shows_an_example_and_explains_its_keys(name):
    text = help_text(name)
    assert "\n    python -m clearance." in text.split("Keys,")[0]
    assert "_target_" not in text
    keys = text.split("Keys,")[1].split("\n\n")[0].splitlines()[1:]
    assert keys
    unexplained = [line for line in keys if len(line.split("   ", 1)) == 1]
    assert len(unexplained) <= 2, unexplained  # runs=1000 and seed=1 speak for themselves


def test_predict_says_that_it_takes_a_folder():
    assert "recordings=???" in help_text("predict")
    assert "or a folder of them" in help_text("predict")


def test_groups_that_a_command_refuses_are_not_offered():
    assert "  integrator=" in help_text("diagnose")
    text = help_text("diagnose", UNUSED)
    assert all(f"  {group}=" not in text for group in UNUSED)
    assert "  joint=" in text


def test_keys_and_comments_are_the_files_own():
    text = help_text("diagnose")
    assert "What does the model lack?" in text
    assert "most_effects=null" in text
    assert "how many may be missing at once" in text
    assert "hydra" not in text.split("Groups")[0]


def test_groups_begin_with_the_chosen_option_and_leave_out_what_a_command_cannot_do():
    text = help_text("train")
    assert "lstm, gru, random_forest" in text
    experiments = next(line for line in text.splitlines() if line.startswith("  experiment="))
    assert "quick, best" in experiments
    assert "by_window" in experiments
    assert "trial" not in experiments
    assert "figure" not in experiments
    trials = next(line for line in help_text("trial").splitlines() if line.startswith("  experiment="))
    assert "trial_full" in trials
    assert "by_runs" not in trials


def test_what_the_chosen_experiment_says_is_what_holds():
    text = help_text("train")
    assert "  runs=300 " in text
    assert "one_cycle, paper" in text
    assert "random, regular" in text
    assert "  scope.cases=12 " in help_text("trial")


def test_what_is_nested_is_named_from_the_top_and_hidden_without_a_comment():
    text = help_text("train")
    assert "calibration.coverage=0.9" in text
    assert "metrics.label_range" not in text
    assert "${labels" in text  # a reference with a comment is one that a user may set
    assert "campaign={" not in text
