"""The commands and facts that the results site gives for rerunning a submission."""

import shlex

from hab_eval.cli import COMMANDS
from hab_eval.leaderboard import default_submissions, read_submissions
from hab_eval.site.entries import make_entries
from hab_eval.site.reruns import command_lines, facts_of, needs_path, run_command, verify_command
from hab_eval.submissions.replay import Replay
from site_records import CLEAN_COMMIT, record_of

from hab_tasks.options import parse_command


def entry_of(record, name="x.json"):
    (entry,) = make_entries({name: record})
    return entry


def test_the_command_repeats_the_run():
    record = record_of(
        [None] * 3,
        agent="hab_spa:tp_spa",
        env="HabPick-v1",
        scene_dataset="replicaCAD",
        objects="ycb",
        split="train+objects",
        seed=7,
        options={"navigation": "teleport", "file": "a b"},
        skill_config={"force_limit_n": 2500.0},
        step_timeout_s=1.5,
    )
    entry = entry_of(record, "one.json")
    assert command_lines(entry) == [f"git checkout {CLEAN_COMMIT}", run_command(entry)]
    assert run_command(entry) == (
        "hab-eval run --agent hab_spa:tp_spa --env HabPick-v1 --scene-dataset PATH/replicaCAD "
        "--objects PATH/ycb --split train --novel objects --episodes 3 --seed 7 "
        "--option navigation=teleport --option 'file=a b' --skill-config force_limit_n=2500.0 "
        "--step-timeout 1.5 --out runs/one"
    )
    assert needs_path(record)
    assert verify_command(entry) == (
        "hab-eval verify one --episodes 10 --scene-dataset PATH/replicaCAD --objects PATH/ycb"
    )


def test_the_commands_of_every_submission_give_its_configuration():
    for name, record in read_submissions(default_submissions()).items():
        words = shlex.split(run_command(entry_of(record, name)))
        command = parse_command("hab-eval", COMMANDS, words[1:], "")
        given = None if command.scene_dataset == "apartment" else command.scene_dataset
        replay = Replay(
            record=record,
            indices=range(len(record.episodes)),
            scene_dataset=given,
            objects=command.objects,
        )
        assert command.config_of(command.episodes, command.step_timeout) == replay.config(), name
        words = shlex.split(verify_command(entry_of(record, name)))
        verify = parse_command("hab-eval", COMMANDS, words[1:], "")
        assert verify.submission == name.removesuffix(".json")
        if record.options:  # reading each again takes seconds
            assert verify.read() == (name.removesuffix(".json"), record)
        assert (verify.scene_dataset, verify.objects) == (given, command.objects), name


def test_a_command_of_hostile_text_is_one_word_for_the_shell():
    hostile = "x'; rm -rf ~; $(reboot) `id`"
    entry = entry_of(record_of([None], agent=hostile, options={"a": hostile}))
    words = shlex.split(run_command(entry))
    assert words[3] == hostile
    assert f"a={hostile}" in words


def test_layouts_and_commits_of_a_run():
    wild = entry_of(record_of([None], scene_dataset="apartment_wild_3", git="abc then def-dirty"))
    commit, vary, run = command_lines(wild)
    assert commit == "git checkout def"
    assert dict(facts_of(wild))["commit"] == "abc then def-dirty"
    assert vary == "hab-tasks vary apartment --wild --count 100 --seed 3 --out apartment_wild_3"
    assert "--scene-dataset apartment_wild_3 " in run
    assert not needs_path(wild.record)
    assert needs_path(record_of([None], scene_dataset="replicaCAD_wild_0"))
    ppo = entry_of(record_of([None], agent="hab_ppo:pick_blind"))
    assert dict(facts_of(ppo))["weights"].startswith("pick_blind, shipped with hab_ppo")
