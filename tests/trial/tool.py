"""A stand-in for the diagnosis: answers what the test has written down for a case, or from the recordings.

``python tool.py ANSWERS recordings=[...] ... hydra.run.dir='DIR'``: ANSWERS is a JSON of case to diagnosis,
``"hang"`` or ``"fail"``; a case that is not in it gets a verdict that depends on the recordings' bytes alone.
Each call leaves a line in ANSWERS.log.
"""

import hashlib
import json
import re
import sys
import time
from pathlib import Path


def verdict(name="none", effects=(), clearance=3e-4, **changes):
    """A diagnosis by the contract."""
    return {
        "verdict": name,
        "mismatch": {"detected": name != "none", "body": None, "direction": None},
        "effects": list(effects),
        "equivalent": [],
        "free_form": None,
        "fit": {
            "metric": "", "held_out": {"before": 1.0, "after": 1.0, "floor": 1.0, "low": 0.9, "high": 1.1},
        },
        "clearance": {
            "joint": "C", "before_m": clearance, "after_m": clearance, "low_m": 0.99 * clearance,
            "high_m": 1.01 * clearance,
        },
        **changes,
    }  # fmt: skip


def main():
    answers = Path(sys.argv[1])
    arguments = dict(argument.split("=", 1) for argument in sys.argv[2:])
    folder = Path(arguments["hydra.run.dir"].strip("'"))
    with Path(f"{answers}.log").open("a") as log:
        log.write(f"{folder.name}\n")
    answer = json.loads(answers.read_text()).get(folder.name)
    if answer == "hang":
        time.sleep(60)
    if answer == "fail":
        sys.exit("error: the recordings show another machine")
    if answer is None:
        recordings = re.findall(r"'([^']+)'", arguments["recordings"])
        seen = hashlib.sha256(b"".join(Path(path).read_bytes() for path in recordings))
        answer = verdict(clearance=1e-4 + int(seen.hexdigest()[:4], 16) * 1e-8)
    (folder / "diagnosis.json").write_text(json.dumps(answer))


if __name__ == "__main__":
    main()
