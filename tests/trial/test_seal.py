"""Nobody who diagnoses can know the truth, and nobody who scores can change it."""

import json
import os
import re
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from filelock import FileLock
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from clearance.commands import CONFIGURATION
from clearance.errors import InputError
from clearance.mechanism.frame import FixedFrame, FlexibleFrame
from clearance.processes import RUNNING
from clearance.recording.files import read
from clearance.trial.case import KNOWN_FRAME
from clearance.trial.conceal import CASE, COMMITMENT, conceal
from clearance.trial.draw import Drawing
from clearance.trial.examine import DIAGNOSIS, VERDICT, VERDICTS, Examiner
from clearance.trial.plant import write_parquet
from clearance.trial.repertoire import EFFECTS, FAULTS
from clearance.trial.reveal import commit_verdicts, reveal
from clearance.trial.score import score_case
from clearance.trial.seal import TRUTH, close, digest, unlock
from clearance.trial.simulate import simulate
from clearance.trial.summary import failures, summarise
from clearance.whole_files import read_json, write_json
from tests.command_line import call, command, environment
from tests.trial.conftest import SCOPE, TOOL
from tests.trial.tool import verdict


def verdicts(trial):
    return {path.parent.name: path.read_bytes() for path in trial.folder.glob(f"{VERDICTS}/*/diagnosis.json")}


def test_the_commitment_is_published_before_any_verdict_and_fits_the_truth(trial):
    published = read_json(trial.folder / COMMITMENT)
    assert not (trial.folder / VERDICTS).exists()
    unlock(trial.sealed)
    assert digest((trial.sealed / TRUTH).read_bytes()) == published["sha256"]
    assert set(published["recordings"]) == {
        str(path.relative_to(trial.folder)) for path in trial.folder.glob("cases/*/*.parquet")
    }


def test_the_same_truth_sealed_twice_has_two_commitments(tmp_path):
    truth = {"seed": 1, "cases": []}
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    assert close(tmp_path / "a", truth) != close(tmp_path / "b", truth)
    for name in "ab":
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0
        unlock(tmp_path / name)
        assert stat.S_IMODE((tmp_path / name / TRUTH).stat().st_mode) == 0o600


def test_a_concealment_is_made_once_and_another_scope_is_refused(trial):
    before = read_json(trial.folder / COMMITMENT)
    said: list[str] = []
    assert conceal(SCOPE, None, trial.folder, trial.sealed, 1, said.append) == before
    assert len(said) == 1  # another seed would not be drawn from
    assert "with the seed it was drawn from" in said[0]
    other = type(SCOPE)(**{**vars(SCOPE), "cases": 5})
    with pytest.raises(InputError, match="drawn otherwise; choose another folder"):
        conceal(other, None, trial.folder, trial.sealed, 1, pytest.fail)
    with pytest.raises(InputError, match="set sealed to a folder elsewhere"):
        conceal(SCOPE, 1, trial.folder, trial.folder / "truth", 1, pytest.fail)
    with pytest.raises(InputError, match=r"lies inside sealed = .*nobody may enter"):
        conceal(SCOPE, 1, trial.folder / "mine", trial.folder, 1, pytest.fail)


def test_a_folder_that_holds_something_else_is_not_shut(tmp_path):
    (tmp_path / "sealed").mkdir()
    (tmp_path / "sealed" / "thesis.txt").write_text("dear")
    before = stat.S_IMODE((tmp_path / "sealed").stat().st_mode)
    with pytest.raises(InputError, match=r"holds other files \(thesis\.txt\); choose an empty folder"):
        conceal(SCOPE, 1, tmp_path / "open", tmp_path / "sealed", 1, pytest.fail)
    assert stat.S_IMODE((tmp_path / "sealed").stat().st_mode) == before


def test_the_truth_of_one_trial_is_not_sealed_again_for_another_folder(trial):
    def truth():
        unlock(trial.sealed)
        content = (trial.sealed / TRUTH).read_bytes()
        trial.sealed.chmod(0)
        return content

    before, elsewhere = truth(), trial.folder.with_name("elsewhere")
    other = type(SCOPE)(**{**vars(SCOPE), "cases": 5})
    for scope, words in (
        (SCOPE, "that are not in folder"),
        (other, "holds the truth of a trial drawn other"),
    ):
        with pytest.raises(InputError, match=words):
            conceal(scope, None, elsewhere, trial.sealed, 1, pytest.fail)
        assert stat.S_IMODE(trial.sealed.stat().st_mode) == 0
        assert truth() == before
    reveal_is_possible = digest(before) == read_json(trial.folder / COMMITMENT)["sha256"]
    assert reveal_is_possible


def test_an_interrupted_concealment_goes_on_with_the_same_cases(tmp_path):
    scope = type(SCOPE)(**{**vars(SCOPE), "cases": 2, "shares": {"none": 1, "effect": 1}})

    def stop(line):
        raise KeyboardInterrupt

    public, sealed = tmp_path / "public", tmp_path / "sealed"
    with pytest.raises(KeyboardInterrupt):
        conceal(scope, None, public, sealed, 1, stop)
    assert not (public / COMMITMENT).exists()
    first = {path: path.read_bytes() for path in public.rglob("*.parquet")}
    assert first
    conceal(scope, None, public, sealed, 1, lambda line: None)
    assert len(list(public.rglob("*.parquet"))) == 2
    assert all(path.read_bytes() == content for path, content in first.items())
    unlock(sealed)
    seed = json.loads((sealed / TRUTH).read_text())["seed"]
    assert seed >= 2**16  # drawn by the system, and in nobody's configuration


def test_a_recording_that_a_loss_of_power_has_cut_is_noticed_before_it_is_diagnosed(trial):
    unlock(trial.sealed)
    part = json.loads((trial.sealed / TRUTH).read_text())["cases"][0]
    assert all((trial.folder / name).stat().st_size > 1000 for name in part["recordings"])
    (trial.sealed / TRUTH).unlink()
    (trial.folder / COMMITMENT).unlink()
    name = next(iter(part["recordings"]))
    (trial.folder / name).write_bytes((trial.folder / name).read_bytes()[:1000])
    with pytest.raises(InputError, match=rf"not as they were \({name}\); choose another sealed"):
        conceal(SCOPE, None, trial.folder, trial.sealed, 1, lambda line: None)


def test_each_case_says_which_version_was_asked(trial, monkeypatch):
    """One that goes on after its sources were changed is of two versions, and a result says so."""
    monkeypatch.setattr("clearance.trial.examine.revision", lambda: "before")
    trial.answer({"case_0001": "fail"})
    trial.examine()
    monkeypatch.setattr("clearance.trial.examine.revision", lambda: "after")
    trial.answer({})
    trial.examine(retry=True)
    facts, _ = reveal(trial.folder, trial.sealed)
    assert [one["revision"] for one in facts["asked"]] == ["after", "before"]


def test_files_tell_their_shape_and_nothing_else(trial):
    """Of the same shape: the same size to the byte, whatever is in it; no metadata, no time."""
    words = [*EFFECTS, *FAULTS, "seed", "visibility"]
    told = {one for case in trial.truth()["cases"] for one in case["truth"]["without"]}
    for path in trial.folder.glob("cases/*"):
        assert [one.stat().st_mtime for one in (path, *path.iterdir())] == [0, 0, 0]
    for path in trial.folder.rglob("*"):
        if path.is_file():
            assert not [w for w in words if w not in told and w.encode() in path.read_bytes()], path
    sizes = {}
    for path in trial.folder.glob("cases/*/*.parquet"):
        table = pq.read_table(path)
        assert table.schema.metadata is None
        assert path.name == "1.parquet"
        sizes.setdefault((table.num_rows, table.num_columns), set()).add(path.stat().st_size)
        assert read(path).rate == pytest.approx(10_000.0)
    assert all(len(found) == 1 for found in sizes.values())


def test_a_clipped_channel_makes_no_smaller_file(tmp_path):
    scope = type(SCOPE)(**{**vars(SCOPE), "cases": 7, "shares": {"instrument": 1}})
    cases = [Drawing(scope, 2).case(i) for i in range(7)]
    (clipped,) = [case for case in cases if "sensor_saturation" in case.faults]
    sizes = []
    for number, case in enumerate((clipped, clipped.lacking("sensor_saturation"))):
        (recording,) = simulate(case).recordings
        path = tmp_path / f"{number}.parquet"
        write_parquet(recording, path)
        sizes.append(path.stat().st_size)
    assert sizes[0] == sizes[1]


def test_a_case_that_is_begun_as_a_trial_is_stopped_is_ended_and_asked_again_another_time(trial):
    trial.answer({"case_0001": "hang"})
    examiner = Examiner([sys.executable, str(TOOL), str(trial.answers)])
    stopped, running = threading.Event(), set()
    stopped.set()
    began = time.monotonic()
    examiner._ask(trial.folder, "case_0001", running, stopped, pytest.fail)
    assert time.monotonic() - began < 20.0
    assert not running
    assert not (trial.folder / VERDICTS / "case_0001" / VERDICT).exists()


def test_a_case_that_another_process_is_asking_is_left_to_it(trial):
    place = trial.folder / VERDICTS / "case_0002"
    place.mkdir(parents=True)
    with FileLock(place / ".asked"):
        trial.examine()
    assert sorted(trial.asked()) == ["case_0001", "case_0003", "case_0004"]
    trial.examine()
    assert trial.asked()[3:] == ["case_0002"]


def test_a_case_waits_for_what_a_killed_trial_has_left_running(trial):
    """A diagnosis that is begun beside it would refuse, and count as failed."""
    place = trial.folder / VERDICTS / "case_0002"
    place.mkdir(parents=True)
    thread = threading.Thread(target=trial.examine)
    with FileLock(place / RUNNING):
        thread.start()
        thread.join(5.0)
        assert sorted(trial.asked()) == ["case_0001", "case_0003", "case_0004"]
    thread.join(20.0)
    assert trial.asked()[3:] == ["case_0002"]
    assert read_json(place / VERDICT)["failure"] is None


def test_the_truth_is_not_needed_for_the_verdicts(trial):
    trial.examine()
    first = verdicts(trial)
    assert len(first) == SCOPE.cases
    assert len(set(first.values())) == SCOPE.cases
    for path in trial.folder.glob(f"{VERDICTS}/*/{VERDICT}"):
        path.unlink()
    gone = trial.sealed.with_name("gone")
    trial.sealed.rename(gone)
    trial.examine()
    assert verdicts(trial) == first
    gone.rename(trial.sealed)


def test_a_process_without_special_rights_cannot_read_the_seal():
    """Not even the owner's, while it is closed; a superuser's is started as nobody here."""
    with tempfile.TemporaryDirectory() as name:
        home, user = Path(name), 65534 if os.geteuid() == 0 else None
        home.chmod(0o755)
        (home / "sealed").mkdir()
        close(home / "sealed", {"seed": 1, "cases": []})
        (home / "open").write_text("readable")
        for path, expected in ((home / "open", "readable"), (home / "sealed" / TRUTH, "")):
            done = subprocess.run(["cat", str(path)], capture_output=True, text=True, user=user)
            assert done.stdout == expected
        unlock(home / "sealed")


def test_the_seal_opens_only_when_every_verdict_is_in(trial):
    trial.answer({"case_0002": "hang"})
    with pytest.raises(InputError, match="4 of 4 cases have no verdict"):
        commit_verdicts(trial.folder)
    assert not (trial.folder / f"{VERDICTS}.json").exists()
    trial.examine(time_limit=1.5)
    commit_verdicts(trial.folder)
    _, cases = reveal(trial.folder, trial.sealed)
    failures = {one.case.name: one.failure for one in cases}
    assert failures == {f"case_000{i}": None for i in (1, 3, 4)} | {"case_0002": "no verdict within 1.5 s"}


def test_a_changed_truth_is_refused(trial):
    trial.examine()
    unlock(trial.sealed)
    content = json.loads((trial.sealed / TRUTH).read_text())
    content["cases"][0]["truth"]["clearance"] = 3e-4
    (trial.sealed / TRUTH).write_text(json.dumps(content))
    with pytest.raises(InputError, match="changed after it was sealed"):
        reveal(trial.folder, trial.sealed)


def test_a_changed_verdict_is_refused(trial):
    trial.examine()
    facts, _ = reveal(trial.folder, trial.sealed)
    assert facts["scope"]["cases"] == SCOPE.cases
    (asked,) = facts["asked"]
    assert asked["program"] == f"python {TOOL} {trial.answers}"
    reveal(trial.folder, trial.sealed)
    path = trial.folder / VERDICTS / "case_0003" / VERDICT
    path.write_text(path.read_text().replace("none", "unknown"))
    with pytest.raises(InputError, match="case_0003 was changed after the seal was opened"):
        reveal(trial.folder, trial.sealed)


def test_a_changed_recording_is_refused(trial):
    trial.examine()
    path = trial.folder / "cases/case_0001/1.parquet"
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    with pytest.raises(InputError, match="not the recording that was concealed"):
        reveal(trial.folder, trial.sealed)


def test_a_changed_word_to_the_tool_is_refused(trial):
    """A wrong hypothesis that is taken away, or a frame of which it was not told, would help."""
    trial.examine()
    path = trial.folder / "cases/case_0001" / CASE
    told = read_json(path)
    write_json(path, {**told, "without": ["gravity"]})
    with pytest.raises(InputError, match=r"case_0001/case\.json is not what was to be told"):
        reveal(trial.folder, trial.sealed)
    write_json(path, told)
    reveal(trial.folder, trial.sealed)


@pytest.mark.parametrize("known_frame", [False, True])
def test_the_tool_understands_what_it_is_told(trial, known_frame):
    """The overrides of a case compose with the diagnosis' own configuration."""
    told = {"joint": "B", "known_frame": known_frame, "without": ["torque_ripple"]}
    write_json(trial.folder / "cases/case_0002" / CASE, told)
    command = Examiner(DIAGNOSIS, ["most_effects=1"]).command(trial.folder, "case_0002")
    overrides = [one for one in command[3:] if not one.startswith("hydra.")]
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        cfg = compose("diagnose", overrides)
        own = compose(
            "baseline", [one for one in overrides if one.split("=")[0] in ("recordings", "without", "joint")]
        )
    assert (own.joint.name, own.without, own.recordings) == (cfg.joint.name, cfg.without, cfg.recordings)
    assert [Path(path).name for path in cfg.recordings] == ["1.parquet"]
    assert (cfg.joint.name, list(cfg.without), cfg.workers, cfg.most_effects) == (
        "B",
        ["torque_ripple"],
        1,
        1,
    )
    frame = instantiate(cfg.mechanism, _convert_="all").frame
    assert frame == (FlexibleFrame(**KNOWN_FRAME) if known_frame else FixedFrame())


def test_failures_are_recorded_and_tried_again_on_request(trial):
    trial.answer({"case_0001": "fail"})
    trial.examine()
    failed = read_json(trial.folder / VERDICTS / "case_0001" / VERDICT)
    assert failed["failure"] == "exit code 1: error: the recordings show another machine"
    assert failed["tries"] == 1
    trial.answer({})
    trial.examine()
    assert trial.asked().count("case_0001") == 1
    trial.examine(retry=True)
    assert sorted(trial.asked()) == sorted([*(f"case_000{i}" for i in range(1, 5)), "case_0001"])
    answered = read_json(trial.folder / VERDICTS / "case_0001" / VERDICT)
    assert (answered["failure"], answered["tries"]) == (None, 2)
    summary = summarise([score_case(one) for one in reveal(trial.folder, trial.sealed)[1]])
    assert summary["asked_again"] == 1
    assert "1 asked again after a failure" in failures(summary)


def test_what_failed_is_not_tried_again_after_the_reveal(trial):
    trial.answer({"case_0001": "fail"})
    trial.examine()
    reveal(trial.folder, trial.sealed)
    trial.examine()  # nothing is left to be asked
    with pytest.raises(InputError, match=r"case_0001 would be asked again after the reveal; set retry=false"):
        trial.examine(retry=True)
    reveal(trial.folder, trial.sealed)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"effects": None}, "has no list of effects"),
        ({"effects": [{"name": "gravity", "kind": "physics"}]}, "has no list of effects"),
        ({"effects": [{"name": "gravity", "kind": "physics", "parameters": {"gravity_y": 1.0}}]}, "value"),
        ({"clearance": {}}, "has no clearance.after_m"),
        ({"fit": {}}, "has no fit.held_out"),
        ({"fit": {"held_out": {"after": 1.0}}}, "has no fit.held_out.floor above 0"),
        ({"equivalent": 5}, "has an equivalent that is no list"),
        ({"free_form": {"argument": "time"}}, "has a free_form without"),
        ({"free_form": {"argument": "time", "table": [[1.0]]}}, "has a free_form without"),
        ({"free_form": {"argument": "time", "table": [[1.0, 2.0, 3.0]]}}, "has a free_form without"),
        ({"seconds": float("nan")}, "NaN is no number"),
        ({"verdict": None}, "has no verdict"),
        ({"effects": [{"name": None, "kind": "physics", "parameters": {}}]}, "has no list of effects"),
        (
            {"effects": [{"name": "sensor_gain", "kind": "instrument", "channel": ["a"], "parameters": {}}]},
            "has no list of effects",
        ),
        ({"free_form": {"argument": "time", "table": [], "clocks": 5}}, "has a free_form without"),
        ({"free_form": {"argument": "time", "table": [], "period": "0.2"}}, "has a free_form without"),
        ({"clearance": {"after_m": 10**400}}, "are not all numbers"),
        ({"mismatch": {"score": "high"}}, "whose score is no number"),
        ({"peak_memory_mib": "486 MiB"}, "a peak_memory_mib that is no number"),
        (
            {"fit": {"held_out": {"before": 1.0, "after": 1.0, "floor": 1.0, "shares": ["a"]}}},
            "has fit.held_out.shares that are no mapping",
        ),
        (
            {"fit": {"held_out": {"before": 1.0, "after": 1.0, "floor": 1.0, "shares": {"a": "half"}}}},
            "has fit.held_out.shares that are no mapping to numbers",
        ),
        ({"clearance": {"after_m": 1e200}}, "are not all numbers"),
    ],
)
def test_an_answer_that_cannot_be_scored_is_a_failure_of_its_case(trial, changes, said):
    """Not of the trial, after the reveal, when no other answer can be given any more."""
    trial.answer({"case_0001": {**verdict(), **changes}})
    trial.examine()
    found = read_json(trial.folder / VERDICTS / "case_0001" / VERDICT)
    assert said in found["failure"]
    assert found["diagnosis"] is None
    _, cases = reveal(trial.folder, trial.sealed)
    assert score_case(cases[0])["right"] is False


def running(word):
    """Processes with a word in their command line."""
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended meanwhile
            lines.append(path.read_bytes().decode(errors="replace"))
    return [line for line in lines if word in line]


@pytest.mark.parametrize(
    "how", [signal.SIGKILL, signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_killed_and_resumed_nothing_is_asked_twice(trial, how):
    """The second case hangs: the first is kept, and only what had no verdict is asked again."""
    trial.answer({"case_0002": "hang"})
    arguments = command(
        "trial", "stage=diagnose", "parallel=1", f"folder='{trial.folder}'", f"sealed='{trial.sealed}'",
        f"program=[{sys.executable},{TOOL},{trial.answers}]", f"hydra.run.dir='{trial.answers}.run'",
    )  # fmt: skip
    process = subprocess.Popen(
        arguments, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    deadline = time.time() + 60
    while len(trial.asked()) < 2 and time.time() < deadline:
        time.sleep(0.05)
    process.send_signal(how)
    process.wait(20)
    if how != signal.SIGKILL:
        assert not running(str(trial.answers))
    assert trial.asked() == ["case_0001", "case_0002"]
    kept = trial.folder / VERDICTS / "case_0001" / VERDICT
    written = kept.stat().st_mtime_ns
    assert not (trial.folder / VERDICTS / "case_0002" / VERDICT).exists()
    trial.answer({})
    trial.examine()
    assert kept.stat().st_mtime_ns == written
    assert Path(f"{trial.answers}.log").read_text().split().count("case_0001") == 1
    assert len(verdicts(trial)) == SCOPE.cases


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("stage=later", "stage = 'later' is unknown; choose from all, conceal, diagnose, baselines, reveal"),
        ("parallel=0", "parallel = 0 is not a whole number, 1 or more; change parallel"),
        ("seed=-1", "seed = -1 is not a whole number, 0 or more, or null; change seed"),
        ("shard=3/2", "shard = 3/2 must be k/n with 1 <= k <= n; change shard"),
        ("scope.cases=0", "cases = 0 is not a whole number .*; change scope.cases"),
        ("scope.shares.nothing=1", "Could not override 'scope.shares.nothing'"),
        ("stage=reveal", "no concealed cases"),
        ("stage=pool", "stage = pool writes its result to results, which is null; set results to a file"),
        ("baselines=[guess]", "baselines: 'guess' is unknown; choose from trajectory, sparse, two_sample"),
        ("baselines=sparse", "baselines = 'sparse' is no list of words"),
        ("program=python", "program = 'python' is no list of words"),
        ("arguments=[5]", r"arguments = \[5\] is no list of words"),
        ("retry=perhaps", "retry = 'perhaps' is neither true nor false; change retry"),
        ("stage=loop", "choose experiment=closed_loop, or set loop"),
        ("arguments=[time_limit=400]", "a value with = needs quotes"),
        ("pictures=a.png", "pictures = a.png: is a file; set pictures to a folder"),
        ("history=page.md", "history = page.md lists .* beside results, which is None; set results"),
        ("shard=1/2", "shard = 1/2: cases are diagnosed in parts, .* set stage=diagnose, or shard=1/1"),
        ("stage=baselines", r"stage = baselines runs those of baselines, which is \[\]; list trajectory"),
        ("folder=7", "folder = 7 is no folder; set folder to the path of one"),
        ("sealed=null", "sealed = None is no folder; set sealed to the path of one"),
        ("scope=null", "scope = None says nothing of how cases are drawn; set scope.cases alone"),
        ("readme=page.md", "readme = page.md: there is no such page; change readme"),
        ("readme=a.png", "readme lacks the lines .*trial.* in this order"),
    ],
)
def test_a_wrong_input_is_one_line(monkeypatch, capfd, tmp_path, override, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "verdicts").mkdir()
    (tmp_path / "a.png").touch()
    code, error = call(monkeypatch, capfd, "trial.__main__", override, "hydra.run.dir=run")
    assert code == 2
    assert re.fullmatch(f"error: .*{words}.*\n", error), error
    assert not (tmp_path / "outputs").exists()


def test_baselines_that_would_fail_on_every_case_are_refused_before_it_is_concealed(
    monkeypatch, capfd, tmp_path
):
    monkeypatch.chdir(tmp_path)
    overrides = ("experiment=trial_sensors", "baselines=[trajectory]", "hydra.run.dir=run")
    code, error = call(monkeypatch, capfd, "trial.__main__", *overrides)
    assert code == 2
    assert "baselines = ['trajectory']: they know nothing of sensors within tolerances" in error
    assert not (tmp_path / "outputs").exists()
