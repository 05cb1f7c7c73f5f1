"""Invalid options of `hab-tasks` and `hab-planner`: one-line error, no output files."""

import os
import shutil
import socket
import tempfile
from pathlib import Path

import pytest
from hab_planner.cli import main as planner
from refusals import check_each, refused_by_command

from hab_tasks.cli import main
from hab_tasks.commands import COMMANDS

NUMBERS = ("-1", "abc", "1.5", "inf", "9" * 20, "")
COUNTS = ("0", *NUMBERS)

EPISODES = ("episodes", "--env", "HabPick-v1", "--out", "out.json")
VARY = ("vary", "apartment", "--macro", "sc1", "--out", "out")
ASSETS = ("assets", "apartment", "--out", "out")
DEMO = ("demo", "HabPick-v1")
CHECK = ("check", "apartment")


OPTIONS = (
    (EPISODES, "--count", COUNTS),
    (EPISODES, "--workers", ("0", "-1")),
    (EPISODES, "--seed", NUMBERS),
    (VARY, "--count", ("0", "abc")),
    (VARY, "--seed", ("-1", "abc")),
    (ASSETS, "--workers", ("0", "abc")),
    (ASSETS, "--texture-size", ("0", "-1", "abc")),
    (ASSETS, "--decimate", ("0", "-1", "nan", "inf", "abc")),
    (DEMO, "--steps", ("0", "abc")),
    (DEMO, "--episode", ("-1", "abc", "9" * 20)),
    (DEMO, "--seed", ("-1", "abc")),
    (CHECK, "--workers", ("0", "abc")),
)

CASES = {
    **{
        f"{arguments[0]} {option} {value!r}": ((*arguments, option, value), (option,))
        for arguments, option, values in OPTIONS
        for value in values
    },
    **{
        " ".join(arguments): (arguments, words)
        for arguments, words in (
            (("episodes", "--env", "HabPik-v1", "--out", "out.json"), ("HabPick-v1",)),
            (("episodes", "--out", "out.json"), ("--env",)),
            ((*EPISODES, "--split", "trane"), ("'trane'", "train")),
            ((*EPISODES, "--scene", "v9"), ("'v9'", "apt_0")),
            ((*EPISODES, "--novel", "all"), ("'all'", "receptacles")),
            ((*EPISODES, "--scene-dataset", "flat"), ("'flat'", "apartment")),
            ((*EPISODES, "--objects", "cups"), ("'cups'", "YCB")),
            ((*EPISODES, "--cuont", "3"), ("--cuont", "--count")),
            (("vary", "flat", *VARY[2:]), ("'flat'", "apartment")),
            (("vary", "apartment", "--macro", "sc9", "--out", "out"), ("'sc9'", "sc1")),
            (("vary", "apartment", "--out", "out"), ("--macro", "--wild")),
            ((*ASSETS, "--collision", "ball"), ("'ball'", "hull")),
            ((*ASSETS, "--texture-format", "bmp"), ("'bmp'", "ktx2")),
            (("demo", "HabPik-v1"), ("HabPick-v1",)),
            ((*DEMO, "--agent", "ghost"), ("'ghost'", "keyboard")),
            ((*DEMO, "--out", "out.gif"), ("out.gif", ".mp4")),
            (("check", "flat"), ("'flat'", "apartment")),
            ((*CHECK, "--scenes", "v9"), ("--simulate",)),
            (("convert", "gone.json", "--out", "out.json"), ("gone.json",)),
            (("convert", ".", "--out", "out.json"), ("not a regular file",)),
            (("convert", "gone.json", "--out", "out.txt"), ("out.txt", ".json.gz")),
            (
                ("figures", "apartment", "--out", "out", "--episodes", "gone.json"),
                ("gone.json",),
            ),
            (("list", "more"), ("more",)),
            (("epizodes",), ("'epizodes'", "episodes")),
        )
    },
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


def test_an_option_that_makes_no_sense_is_refused(elsewhere):
    def check(case):
        arguments, words = case
        refused_by_command(main, arguments, *words)
        assert not list(elsewhere.iterdir())

    check_each(CASES, check)


def test_the_planner_refuses_what_makes_no_sense(elsewhere):
    def check(case):
        arguments, words = case
        refused_by_command(planner, arguments, *words)
        assert [path.name for path in elsewhere.iterdir()] == ["file"]

    Path("file").write_text("precious")
    check_each(PLANNER, check)


def test_all_that_write_are_tried():
    assert set(WRITES) == {
        name for name, options in COMMANDS.items() if "out" in options.__dataclass_fields__
    }


def test_what_may_not_be_replaced_stays(elsewhere, monkeypatch):
    """Every place with a command that writes a folder and one that writes a file; two with all."""

    def check(case):
        command, place, force = case
        folder = Path(tempfile.mkdtemp(dir=elsewhere))
        monkeypatch.chdir(folder)
        arguments, target = WRITES[command]
        out = place(target)
        before = {path: path.lstat() for path in folder.rglob("*")}
        refused_by_command(main, [*arguments, "--out", out, *(["--force"] * force)], target[:3])
        after = {path: path.lstat() for path in folder.rglob("*")}
        assert {p: (s.st_mode, s.st_ino) for p, s in after.items()} == {
            p: (s.st_mode, s.st_ino) for p, s in before.items()
        }

    few = (of_the_wrong_kind, below_a_file)
    cases = {
        f"{command} {place.__name__} {force}": (command, place, force)
        for command in WRITES
        for place in (PLACES if command in ("figures", "episodes") else few)
        for force in (False, True)
    }
    check_each(cases, check)


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
