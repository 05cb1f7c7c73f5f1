"""The studies of the supplement: resumed after kills, refused early, run at their quick scale."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch
from hab_eval.records.results import read_record
from hab_ppo.cli import main
from hab_ppo.studies.grad_cam import correlation
from hab_ppo.studies.registry import DECLARED, STUDIES
from killed import session_of

LEFT_COUNTER = "hab_tasks.skills.pick_left_counter:HabPickLeftCounter-v1"
MOST_WORDS = 400

TINY = """
import sys
from dataclasses import replace
from pathlib import Path
from hab_ppo.commands import StudyCommand
from hab_ppo.studies.engine import run_study
from hab_ppo.studies.left_counter import DELAY
from hab_ppo.studies.study import Budget

budget = Budget(
    steps=160, labelled=(2, 60), training_episodes=4, evaluations=2, validation_episodes=2,
    episodes=4,
)
arm = DELAY.arms[0]
recipe = replace(arm.recipe, preset=replace(arm.recipe.preset, rows=4, rollout_steps=20))
taught = replace(
    arm, recipe=recipe, budgets={"quick": budget}, conditions=arm.conditions[:1], name="taught"
)
untaught = replace(taught, name="untaught", recipe=replace(recipe, distill=None))
study = replace(DELAY, arms=(untaught, taught))
run_study(study, StudyCommand(study="f5", out=Path(sys.argv[1])))
"""


def started(out):
    return subprocess.Popen([sys.executable, "-c", TINY, str(out)], start_new_session=True)


def kill_when(out, pattern):
    """Starts the tiny study, and kills it as soon as it has a file."""
    process = started(out)
    while not list(out.glob(pattern)):
        assert process.poll() is None, "the study ended by itself"
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    while session_of(process.pid):
        time.sleep(0.05)


def results(out):
    """Text of the report, and the results without their times."""
    found = {}
    for path in sorted(out.glob("*.json")):
        data = json.loads(path.read_text())
        episodes = data.get("episodes", [])
        found[path.name] = [{k: v for k, v in one.items() if k != "seconds"} for one in episodes]
    return (out / "README.md").read_text(), found


@pytest.mark.long
def test_a_killed_study_goes_on_to_the_same_tables(tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert started(whole).wait() == 0
    kill_when(killed, "work/taught_seed0/distilled_so_far.safetensors")
    kill_when(killed, "work/*/exact.safetensors")
    kill_when(killed, "work/evaluations/*/episodes.jsonl")
    assert started(killed).wait() == 0
    assert results(killed) == results(whole)


def test_bad_input_is_one_line_before_the_work(tmp_path, capsys):
    out = tmp_path / "study"
    (out / "work").mkdir(parents=True)
    (out / "work" / "study.json").write_text('{"study": "f2", "scale": "quick"}')
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "notes.txt").write_text("mine")
    for words, message in (
        (["f7", "--out", "x"], "Unknown study 'f7'."),
        (["f5", "--scale", "ful", "--out", "x"], "Unknown scale 'ful'. Did you mean 'full'?"),
        (["f5", "--out", str(out)], "holds the study f2 at scale quick, not f5 at scale quick"),
        (["f2", "--scale", "full", "--out", str(out)], "not f2 at scale full"),
        (["f5", "--out", str(foreign)], "contains files but no work/study.json"),
        (["f5", "--workers", "0", "--out", "x"], "--workers 0: it has to be"),
    ):
        assert main(["study", *words]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1
    assert not (tmp_path / "x").exists()


@pytest.mark.slow
def test_colour_without_a_renderer_is_refused_at_once(tmp_path):
    nothing = tmp_path / "nothing"
    nothing.mkdir()
    drivers = dict.fromkeys(("VK_DRIVER_FILES", "VK_ICD_FILENAMES"), str(nothing))
    command = [sys.executable, "-m", "hab_ppo", "study", "f1", "--out", str(tmp_path / "f1")]
    done = subprocess.run(
        command, env=os.environ | drivers, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    (ours,) = (one for one in done.stderr.splitlines() if "svulkan2" not in one)
    assert "Vulkan" in ours
    assert not (tmp_path / "f1").exists()


def test_the_arms_of_a_study_have_files_of_their_own():
    for study in DECLARED:
        slugs = [arm.slug for arm in study.arms]
        assert len(set(slugs)) == len(slugs)
        assert all(arm.budgets.keys() == {"quick", "full"} for arm in study.arms)


def test_maps_correlate_by_their_ranks():
    a = torch.tensor([[[0.0, 1.0], [2.0, 3.0]]])
    assert correlation(a, a.square()) == pytest.approx(1)
    assert correlation(a, -a) == pytest.approx(-1)
    # Ranks 0 1 2 3 against 1 0 2 3: 1 - 6 (1 + 1) / (4 (16 - 1)) = 0.8.
    assert correlation(a, torch.tensor([[[1.0, 0.0], [2.0, 3.0]]])) == pytest.approx(0.8)
    assert correlation(a, torch.ones(1, 2, 2)) == 0  # a constant map has no ranks


def test_start_states_of_the_left_counter(generated):
    _, episodes = generated(LEFT_COUNTER)
    for one in episodes:
        assert len(one.objects) == 5
        assert "counter_left" in str(one.targets[0].start)
    yaws = np.array([one.robot.base[2] for one in episodes])
    xy = np.array([one.robot.base[:2] for one in episodes])
    assert np.ptp(yaws) < 6 * 0.15  # all face the wall, whatever the target
    assert 0.1 < xy.std(axis=0).max() < 1.5


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", STUDIES)
def test_a_study_runs_at_its_quick_scale(name, tmp_path):
    out = tmp_path / name
    assert main(["study", name, "--out", str(out)]) == 0
    text = (out / "README.md").read_text()
    assert len(text.split()) <= MOST_WORDS
    assert (out / f"{name}.png").is_file()
    names = {path.stem for path in out.glob("*.json")}
    assert any(one.endswith("do_nothing") for one in names)
    assert any(one.endswith("random_actions") for one in names)
    for one in names:
        read_record(out / f"{one}.json")
