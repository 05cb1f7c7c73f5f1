"""`hab-eval sweep` and `--env-option`, with a real environment."""

import pytest
from hab_eval.cli import main
from hab_eval.records.results import read_record
from hab_eval.records.sweep import AXES, BASE, FLOOR, change_of, levels_of
from site_records import record_of

AGENT = ("--agent", "hab_eval:straight_line")
PICK = (*AGENT, "--env", "HabPick-v1", "--split", "test", "--episodes", "2")


def test_changes_are_paired_unless_the_episodes_are_others():
    base = record_of([None, None, None, "force"])
    level = AXES["delay"][0]
    # Solved: 3 of 4 before, 1 of 4 after; lost are two, won is none.
    change = change_of(level, base, record_of([None, "x", "x", "x"]))
    assert (change.mean, change.success, change.p_value) == (-0.5, 0.25, 0.5)  # 2 / 2^2
    assert change.ci95[0] < -0.5 < change.ci95[1]
    assert change_of(FLOOR, base, record_of([None] * 4)).p_value is None
    assert [one.axis for one in levels_of(["delay", "delay"])] == ["none", "none"] + ["delay"] * 2
    folders = [one.folder for axis in AXES for one in AXES[axis]]
    assert len({*folders, BASE.folder, FLOOR.folder}) == len(folders) + 2


@pytest.mark.slow
def test_a_sweep_resumes_and_says_what_it_changed(tmp_path, capsys):
    out = tmp_path / "sweep"
    command = ["sweep", *PICK, "--axes", "delay,clutter", "--out", str(out)]
    assert main(command) == 0
    assert (out / "sweep.png").stat().st_size > 1000
    first = capsys.readouterr().out
    assert main([*command, "--resume"]) == 0
    assert first.partition("┃ axis")[2] == capsys.readouterr().out.partition("┃ axis")[2] != ""
    options = {p.parent.name: read_record(p).env_options for p in out.glob("*/run.json")}
    assert options["none"] == options["none_another_seed"] == {}
    assert options["delay_3_steps"] == {"action_delay_steps": "3"}
    assert options["clutter_10_more"] == {"perturbation.clutter": "10"}


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--axes", "cluter"), "Did you mean 'clutter'"),
        (("--axes", "layout"), "--layouts PATH"),
        (("--env-option", "friction=2"), "Did you mean 'perturbation.friction'"),
        (("--env-option", "perturbation.friction=low"), "a number"),
        (("--env-option", "perturbation.camera_m=-1"), "a number from 0"),
        (("--env", "HabOpenFridge-v1", "--axes", "clutter"), "Leave clutter out of --axes"),
    ],
)
def test_bad_input_is_refused_before_the_first_run(tmp_path, capsys, more, words):
    assert main(["sweep", *PICK, *more, "--out", str(tmp_path / "sweep")]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.glob("sweep/*/run.json"))
