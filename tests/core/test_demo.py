"""`hab-tasks demo`: display, output and errors; keys as actions."""

import io
import re
import sys
from types import SimpleNamespace

import pytest

from hab_tasks import rendering
from hab_tasks.commands.keyboard import Keyboard
from hab_tasks.robots.control import control_configs
from hab_tasks.robots.fetch import FETCH

STEP = re.compile(r"^ *(\d+)  reward ([+-][\d.]+)  (.*)$", re.MULTILINE)


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.slow
def test_random_actions_are_told_step_by_step_and_summed(run):
    done = run("demo", "HabPick-v1", "--steps", 4, "--seed", 3)
    assert done.returncode == 0, done.stderr
    told = STEP.findall(done.stdout)
    assert [number for number, _, _ in told] == ["1", "2", "3", "4"]
    assert all("ee_to_object_m 0." in words and "force_n" in words for _, _, words in told)
    total = float(re.search(r"^return +(\S+)$", done.stdout, re.MULTILINE)[1])
    # Four rewards and their sum, each rounded to a thousandth.
    assert total == pytest.approx(sum(float(reward) for _, reward, _ in told), abs=0.003)
    assert "success   no\n" in done.stdout
    assert "no display" in done.stdout
    assert run("demo", "HabPick-v1", "--steps", 4, "--seed", 3).stdout == done.stdout
    other = run("demo", "HabPick-v1", "--steps", 4, "--seed", 4)
    assert STEP.findall(other.stdout) != told


def test_the_episode_is_the_one_asked_for_and_what_it_holds_stays_held(run, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("  g"))
    done = run("demo", "HabPlace-v1", "--agent", "keyboard", "--episode", 7)
    assert done.stdout.splitlines()[1].endswith("/00007")
    held = ["holding_target" in words for _, _, words in STEP.findall(done.stdout)]
    assert held == [True, True, False]


def test_keys_move_the_robot_one_action_each(run, monkeypatch):
    # Up, hand ahead; a key of the base, which Pick holds still; grasp; wait; quit; nothing after.
    monkeypatch.setattr(sys, "stdin", io.StringIO("r\x1b[Aw\ng q rr"))
    done = run("demo", "HabPick-v1", "--agent", "keyboard")
    assert done.returncode == 0, done.stderr
    assert len(STEP.findall(done.stdout)) == 4
    assert "'w' has no function in this control mode" in done.stdout
    assert "hand ahead" in done.stdout
    assert "drive ahead" not in done.stdout


def test_a_key_sets_one_entry_of_the_action_or_names_a_cell():
    for mode, key, action in (
        # Hand x, y, z; gripper, -1 is open; forward, turning.
        ("ee_base", "up", [1, 0, 0, -1, 0, 0]),
        ("ee_base", "s", [0, 0, 0, -1, -0.5, 0]),
        ("ee_base", "a", [0, 0, 0, -1, 0, 1]),
        ("ee_base", "space", [0, 0, 0, -1, 0, 0]),
        ("ee_base", "g", [0, 0, 0, 1, 0, 0]),
        ("ee_base", "x", None),
        ("ee", "w", None),
        # Five turning velocities for each of -0.5, 0, 0.5, 1: (1, 0) is 3 * 5 + 2.
        ("base_discrete", "w", 17),
        ("base_discrete", "space", 7),
        ("base_discrete", "up", None),
    ):
        board = Keyboard(SimpleNamespace(config=control_configs(FETCH)[mode]), holding=False)
        found = board.action(key)
        assert (found.tolist() if isinstance(action, list) else found) == action, (mode, key)


def test_without_vulkan_measures_are_told_all_the_same(run, monkeypatch):
    monkeypatch.setattr(rendering, "software_vulkan_works", lambda: False)
    monkeypatch.setattr(rendering.torch.cuda, "is_available", lambda: False)
    monkeypatch.setenv("DISPLAY", ":0")
    done = run("demo", "HabPick-v1", "--steps", 1)
    assert done.returncode == 0, done.stderr
    assert "no window can be opened. No Vulkan device" in done.stdout
