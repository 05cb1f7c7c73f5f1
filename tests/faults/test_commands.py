"""Invalid options of `hab-tasks` and `hab-planner`: one-line error, no output files."""

import os
import socket
import tempfile
from pathlib import Path

import pytest
from hab_planner.cli import main as planner
from refusals import check_each, refused_by_command

from hab_tasks.cli import main
from hab_tasks.commands import COMMANDS

EPISODES = "episodes --env HabPick-v1 --out out.json"
VARY = "vary apartment --macro sc1 --out out"
ASSETS = "assets apartment --out out"
DEMO = "demo HabPick-v1"

NUMBERS = (
    (EPISODES, "--count", ("0", "-1", "abc", "1.5", "inf", "9" * 20, "")),
    (EPISODES, "--workers", ("0", "-1")),
    (EPISODES, "--seed", ("-1", "abc", "1.5", "9" * 20)),
    (VARY, "--count", ("0", "abc")),
    (VARY, "--seed", ("-1", "abc")),
    (ASSETS, "--workers", ("0", "abc")),
    (ASSETS, "--texture-size", ("0", "-1", "abc")),
    (ASSETS, "--decimate", ("0", "-1", "nan", "inf", "abc")),
    (DEMO, "--steps", ("0", "abc")),
    (DEMO, "--episode", ("-1", "abc", "9" * 20)),
    (DEMO, "--seed", ("-1", "abc")),
    ("check apartment", "--workers", ("0", "abc")),
)

# Command line -> words of the message.
WORDS = {
    "episodes --env HabPik-v1 --out out.json": ("HabPick-v1",),
    "episodes --out out.json": ("--env",),
    f"{EPISODES} --split trane": ("'trane'", "train"),
    f"{EPISODES} --scene v9": ("'v9'", "apt_0"),
    f"{EPISODES} --novel all": ("'all'", "receptacles"),
    f"{EPISODES} --scene-dataset flat": ("'flat'", "apartment"),
    f"{EPISODES} --objects cups": ("'cups'", "YCB"),
    f"{EPISODES} --cuont 3": ("--cuont", "--count"),
    "vary flat --macro sc1 --out out": ("'flat'", "apartment"),
    "vary apartment --macro sc9 --out out": ("'sc9'", "sc1"),
    "vary apartment --out out": ("--macro", "--wild"),
    f"{ASSETS} --collision ball": ("'ball'", "hull"),
    f"{ASSETS} --texture-format bmp": ("'bmp'", "ktx2"),
    "demo HabPik-v1": ("HabPick-v1",),
    f"{DEMO} --agent ghost": ("'ghost'", "keyboard"),
    f"{DEMO} --out out.gif": ("out.gif", ".mp4"),
    "check flat": ("'flat'", "apartment"),
    "check apartment --scenes v9": ("--simulate",),
    "convert gone.json --out out.json": ("gone.json",),
    "convert . --out out.json": ("not a regular file",),
    "convert gone.json --out out.txt": ("out.txt", ".json.gz"),
    "figures apartment --out out --episodes gone.json": ("gone.json",),
    "list more": ("more",),
    "epizodes": ("'epizodes'", "episodes"),
}
PLANNER = {
    "plan HabPick-v1": ("HabPick-v1", "HabSetTable-v1"),
    "plan HabSetTabel-v1": ("HabSetTable-v1",),
    "plan": ("ID",),
    "plan HabSetTable-v1 --slove": ("--solve",),
    "plann HabSetTable-v1": ("plan",),
    "plan HabSetTable-v1 --out .": ("folder",),
    "plan HabSetTable-v1 --out file/plan": ("file", "not a folder"),
}

# Each command that writes, and how its target ends.
WRITES = {
    "episodes --env HabPick-v1": "out.json",
    "vary apartment --macro sc1": "out",
    "assets apartment": "out",
    DEMO: "out.mp4",
    "convert set.json": "out.json",
    "figures apartment": "out",
    "docs": "out",
}
PLACES = ("below", "dangling", "loop", "socket", "pipe", "kind", "long", "nul")


def put_in_the_way(place: str, target: str) -> str:
    """Makes `target`, or what is above it, something that may not be replaced; returns its path."""
    path = Path(target)
    if place == "below":
        Path("file").write_text("precious")
        return f"file/{target}"
    if place in ("dangling", "loop"):
        path.symlink_to(target if place == "loop" else "nothing")
    elif place == "socket":
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(target)
    elif place == "pipe":
        os.mkfifo(target)
    elif place == "kind":
        path.mkdir() if path.suffix else path.write_text("precious")
    return {"long": "n" * 300 + target, "nul": f"a\0{target}"}.get(place, target)


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

    cases = {line: (line.split(), words) for line, words in WORDS.items()}
    for line, option, values in NUMBERS:
        for value in values:
            cases[f"{line} {option} {value!r}"] = ([*line.split(), option, value], (option,))
    check_each(cases, check)


def test_the_planner_refuses_what_makes_no_sense(elsewhere):
    def check(case):
        line, words = case
        refused_by_command(planner, line.split(), *words)
        assert [path.name for path in elsewhere.iterdir()] == ["file"]

    Path("file").write_text("precious")
    check_each({line: (line, words) for line, words in PLANNER.items()}, check)


def test_what_may_not_be_replaced_stays(elsewhere, monkeypatch):
    """Every place with a command that writes a folder and one that writes a file; two with all."""

    def lying_there(folder):
        return {path: (path.lstat().st_mode, path.lstat().st_ino) for path in folder.rglob("*")}

    def check(case):
        command, place, force = case
        folder = Path(tempfile.mkdtemp(dir=elsewhere))
        monkeypatch.chdir(folder)
        target = WRITES[command]
        out = put_in_the_way(place, target)
        before = lying_there(folder)
        refused_by_command(main, [*command.split(), "--out", out, *force], target[:3])
        assert lying_there(folder) == before

    writing = {name for name, made in COMMANDS.items() if "out" in made.__dataclass_fields__}
    assert {command.split()[0] for command in WRITES} == writing
    cases = [
        (command, place, force)
        for command in WRITES
        for place in (PLACES if command.startswith(("figures", "episodes")) else PLACES[::5])
        for force in ((), ("--force",))
    ]
    check_each({" ".join((*case[:2], *case[2])): case for case in cases}, check)


@pytest.mark.parametrize("command", ["vary apartment --macro sc1", "assets apartment"])
def test_a_folder_of_the_users_own_is_never_replaced(command):
    Path("out/configs").mkdir(parents=True)
    Path("out/configs/thesis.txt").write_text("precious")
    arguments = [*command.split(), "--out", "out", "--force"]
    refused_by_command(main, arguments, "out", "--force does not replace it")
    assert Path("out/configs/thesis.txt").read_text() == "precious"
