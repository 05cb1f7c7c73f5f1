"""Invalid options of `hab-tasks` and `hab-planner`: one-line error, no output files."""

import os
import shutil
import socket
from pathlib import Path

import pytest
from hab_planner.cli import main as planner
from refusals import refused_by_command

from hab_tasks.cli import main
from hab_tasks.commands import COMMANDS

HUGE = "9" * 20
NUMBERS = {
    "zero": "0",
    "negative": "-1",
    "text": "abc",
    "fraction": "1.5",
    "nan": "nan",
    "infinite": "inf",
    "huge": HUGE,
    "empty": "",
}
SEEDS = {kind: value for kind, value in NUMBERS.items() if kind != "zero"}

EPISODES = ("episodes", "--env", "HabPick-v1", "--out", "out.json")
VARY = ("vary", "apartment", "--macro", "sc1", "--out", "out")
ASSETS = ("assets", "apartment", "--out", "out")
DEMO = ("demo", "HabPick-v1")
CHECK = ("check", "apartment")


def each(arguments, option, values):
    """Yields a case for every value of an option."""
    for kind, value in values.items():
        yield f"{arguments[0]}{option}-{kind}", (*arguments, option, value), (option,)


CASES = {
    name: (arguments, words)
    for name, arguments, words in (
        *each(EPISODES, "--count", NUMBERS),
        *each(EPISODES, "--workers", NUMBERS),
        *each(EPISODES, "--seed", SEEDS),
        *each(VARY, "--count", NUMBERS),
        *each(VARY, "--seed", SEEDS),
        *each(ASSETS, "--workers", NUMBERS),
        *each(ASSETS, "--texture-size", NUMBERS),
        *each(ASSETS, "--decimate", {k: v for k, v in NUMBERS.items() if k != "fraction"}),
        *each(DEMO, "--steps", NUMBERS),
        *each(DEMO, "--episode", {"negative": "-1", "text": "abc", "huge": HUGE}),
        *each(DEMO, "--seed", SEEDS),
        *each(CHECK, "--workers", NUMBERS),
        ("episodes-env", ("episodes", "--env", "HabPik-v1", "--out", "out.json"), ("HabPick-v1",)),
        ("episodes-no-env", ("episodes", "--out", "out.json"), ("--env",)),
        ("episodes-no-out", ("episodes", "--env", "HabPick-v1"), ("--out",)),
        ("episodes-split", (*EPISODES, "--split", "trane"), ("'trane'", "train")),
        ("episodes-scene", (*EPISODES, "--scene", "v9"), ("'v9'", "apt_0")),
        ("episodes-novel", (*EPISODES, "--novel", "all"), ("'all'", "receptacles")),
        ("episodes-dataset", (*EPISODES, "--scene-dataset", "flat"), ("'flat'", "apartment")),
        ("episodes-no-dataset", (*EPISODES, "--scene-dataset", ""), ("dataset",)),
        ("episodes-objects", (*EPISODES, "--objects", "cups"), ("'cups'", "YCB")),
        ("episodes-option", (*EPISODES, "--cuont", "3"), ("--cuont", "--count")),
        ("vary-dataset", ("vary", "flat", *VARY[2:]), ("'flat'", "apartment")),
        ("vary-macro", ("vary", "apartment", "--macro", "sc9", "--out", "out"), ("'sc9'", "sc1")),
        ("vary-no-macro", ("vary", "apartment", "--out", "out"), ("--macro", "--wild")),
        ("assets-dataset", ("assets", "flat", "--out", "out"), ("'flat'", "apartment")),
        ("assets-collision", (*ASSETS, "--collision", "ball"), ("'ball'", "hull")),
        ("assets-format", (*ASSETS, "--texture-format", "bmp"), ("'bmp'", "ktx2")),
        ("assets-objects", (*ASSETS, "--objects", "cups"), ("'cups'", "YCB")),
        ("demo-env", ("demo", "HabPik-v1"), ("HabPick-v1",)),
        ("demo-no-env", ("demo",), ("ENV",)),
        ("demo-agent", (*DEMO, "--agent", "ghost"), ("'ghost'", "keyboard")),
        ("demo-ending", (*DEMO, "--out", "out.gif"), ("out.gif", ".mp4")),
        ("demo-dataset", (*DEMO, "--scene-dataset", "flat"), ("'flat'", "apartment")),
        ("demo-objects", (*DEMO, "--objects", "cups"), ("'cups'", "YCB")),
        ("check-dataset", ("check", "flat"), ("'flat'", "apartment")),
        ("check-no-dataset", ("check",), ("DATASET",)),
        ("check-objects", (*CHECK, "--objects", "cups"), ("'cups'", "YCB")),
        ("check-scenes", (*CHECK, "--scenes", "v9"), ("--simulate",)),
        ("convert-absent", ("convert", "gone.json", "--out", "out.json"), ("gone.json",)),
        ("convert-folder", ("convert", ".", "--out", "out.json"), ("not a regular file",)),
        ("convert-no-out", ("convert", "gone.json"), ("--out",)),
        ("convert-ending", ("convert", "gone.json", "--out", "out.txt"), ("out.txt", ".json.gz")),
        ("episodes-ending", (*EPISODES[:4], "out.txt"), ("out.txt", ".json.gz")),
        ("figures-dataset", ("figures", "flat", "--out", "out"), ("'flat'", "apartment")),
        ("figures-no-out", ("figures", "apartment"), ("--out",)),
        (
            "figures-episodes",
            ("figures", "apartment", "--out", "out", "--episodes", "gone.json"),
            ("gone.json",),
        ),
        ("docs-no-out", ("docs",), ("--out",)),
        ("list-more", ("list", "more"), ("more",)),
        ("list-option", ("list", "--all"), ("--all", "--help")),
        ("command", ("epizodes",), ("'epizodes'", "episodes")),
    )
}
PLANNER = {
    "env": (("plan", "HabPick-v1"), ("HabPick-v1", "HabSetTable-v1")),
    "unknown": (("plan", "HabSetTabel-v1"), ("HabSetTable-v1",)),
    "none": (("plan",), ("ID",)),
    "option": (("plan", "HabSetTable-v1", "--slove"), ("--solve",)),
    "command": (("plann", "HabSetTable-v1"), ("plan",)),
    "folder": (("plan", "HabSetTable-v1", "--out", "."), ("folder",)),
    "below": (("plan", "HabSetTable-v1", "--out", "file/plan"), ("file", "not a folder")),
}

# What each command that writes needs beside --out, and how its target ends.
WRITES = {
    "episodes": (EPISODES[:3], "out.json"),
    "vary": (VARY[:4], "out"),
    "assets": (ASSETS[:2], "out"),
    "demo": (DEMO, "out.mp4"),
    "convert": (("convert", "set.json"), "out.json"),
    "figures": (("figures", "apartment"), "out"),
    "docs": (("docs",), "out"),
}


def below_a_file(target):
    Path("file").write_text("precious")
    return f"file/{target}"


def a_link_to_nothing(target):
    Path(target).symlink_to("nothing")
    return target


def a_link_to_itself(target):
    Path(target).symlink_to(target)
    return target


def a_socket(target):
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(target)
    return target


def a_pipe(target):
    os.mkfifo(target)
    return target


def of_the_wrong_kind(target):
    if "." in target:
        Path(target).mkdir()
    else:
        Path(target).write_text("precious")
    return target


def too_long(target):
    return "n" * 300 + target


def with_a_nul(target):
    return f"a\0{target}"


PLACES = (
    below_a_file,
    a_link_to_nothing,
    a_link_to_itself,
    a_socket,
    a_pipe,
    of_the_wrong_kind,
    too_long,
    with_a_nul,
)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Everything relative is below an empty folder, and nothing may be left there."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    return folder


@pytest.mark.parametrize("case", CASES)
def test_an_option_that_makes_no_sense_is_refused(elsewhere, case):
    arguments, words = CASES[case]
    refused_by_command(main, arguments, *words)
    assert not list(elsewhere.iterdir())


@pytest.mark.parametrize("case", PLANNER)
def test_the_planner_refuses_what_makes_no_sense(case):
    arguments, words = PLANNER[case]
    Path("file").write_text("precious")
    refused_by_command(planner, arguments, *words)
    assert [path.name for path in Path().iterdir()] == ["file"]


def test_all_that_write_are_tried():
    assert set(WRITES) == {
        name for name, options in COMMANDS.items() if "out" in options.__dataclass_fields__
    }


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("command", WRITES)
@pytest.mark.parametrize("force", [False, True])
def test_what_may_not_be_replaced_stays(elsewhere, command, place, force):
    arguments, target = WRITES[command]
    out = place(target)
    before = {path: path.lstat() for path in elsewhere.rglob("*")}
    refused_by_command(main, [*arguments, "--out", out, *(["--force"] * force)], target[:3])
    after = {path: path.lstat() for path in elsewhere.rglob("*")}
    assert {p: (s.st_mode, s.st_ino) for p, s in after.items()} == {
        p: (s.st_mode, s.st_ino) for p, s in before.items()
    }


@pytest.mark.parametrize("command", ["vary", "assets"])
def test_a_folder_of_the_users_own_is_never_replaced(elsewhere, command):
    Path("out").mkdir()
    Path("out/thesis.txt").write_text("precious")
    arguments, _ = WRITES[command]
    refused_by_command(
        main, [*arguments, "--out", "out", "--force"], "out", "--force does not replace it"
    )
    assert Path("out/thesis.txt").read_text() == "precious"


def test_the_users_own_dataset_is_never_replaced(elsewhere):
    shutil.copytree(Path(__file__).parents[2] / "assets/apartment/configs", "mine/configs")
    Path("mine/apartment.scene_dataset_config.json").write_text("{}")
    refused_by_command(main, ["assets", "apartment", "--out", "mine", "--force"], "mine")
    assert Path("mine/configs/scenes").is_dir()
