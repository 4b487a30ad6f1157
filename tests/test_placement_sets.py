"""The sets that trainings confirm are those that the ranking names."""

import json
from pathlib import Path

from hydra import compose, initialize_config_dir

from clearance.configuration import CONFIGURATION

RANKING = Path(__file__).parents[1] / "docs/results/placement-C.json"


def test_the_sets_are_the_first_five_of_the_ranking():
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        chosen = [
            list(compose("train", [f"sensors=placement_c{i}", "name=x", "folder=x"]).sensors.channels)
            for i in range(1, 6)
        ]
    ranked = [one["channels"] for one in json.loads(RANKING.read_text())["ranking"]]
    of_four = [set(one) for one in ranked if len(one) == 4]
    assert [set(one) for one in chosen] == of_four[:5]
