"""`hab-tasks demo`: display, output and errors; keys as actions."""

import io
import re
import shutil
import subprocess
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


@pytest.mark.browser
@pytest.mark.slow
def test_keys_and_buttons_in_the_browser_move_the_robot(run):
    pytest.importorskip("viser", reason="the package viser is not installed")
    from playwright.sync_api import sync_playwright

    assert "'wall'. Valid: web, window" in run("demo", "HabPick-v1", "--viewer", "wall").stderr
    command = ("demo", "HabPick-v1", "--agent", "keyboard", "--viewer", "web")
    demo = subprocess.Popen(
        [sys.executable, "-m", "hab_tasks", *command], stdout=subprocess.PIPE, text=True
    )
    lines, faults = [], []
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"),
            args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
        )
        page = chromium.new_page()
        page.set_default_timeout(120_000)
        page.on("console", lambda m: m.type == "error" and faults.append(m.text))
        page.on("pageerror", lambda error: faults.append(str(error)))

        def wait_for(words):
            for line in demo.stdout:
                lines.append(line)
                if words in line:
                    return line
            raise AssertionError("".join(lines))

        page.goto(re.search(r"http\S+", wait_for("open http"))[0])
        page.wait_for_selector("canvas")
        page.get_by_text("8: hand ahead").wait_for()
        page.keyboard.press("8")
        assert float(re.search(r"reward (\S+)", wait_for("reward"))[1]) != 0.0
        page.get_by_text("8: hand ahead").click()
        page.get_by_text("quit").click()
        wait_for("stopped after")
        chromium.close()
    assert demo.wait(timeout=60) == 0
    assert not faults
