"""Invalid options of `hab-tasks` and `hab-planner`: one-line error, no output files."""

import tempfile
from pathlib import Path

import pytest
from hab_plans.cli import main as planner
from refusals import check_each, refused_by_command

from hab_tasks.cli import COMMANDS, main

EPISODES = "episodes --env HabPick-v1 --out out.json"
VARY = "vary apartment --macro sc1 --out out"
ASSETS = "assets apartment --out out"
DEMO = "demo HabPick-v1"

NUMBERS = (
    (EPISODES, "--count", ("0", "abc", "1.5", "inf", "9" * 20, "")),
    (EPISODES, "--workers", ("0",)),
    (EPISODES, "--seed", ("-1", "9" * 20)),
    (VARY, "--count", ("0",)),
    (ASSETS, "--texture-size", ("0",)),
    (ASSETS, "--decimate", ("0", "nan", "inf", "abc")),
    (DEMO, "--steps", ("0",)),
    (DEMO, "--episode", ("-1",)),
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
    "vary apartment --macro sc9 --out out": ("'sc9'", "sc1"),
    "vary apartment --out out": ("--macro", "--wild"),
    f"{ASSETS} --collision ball": ("'ball'", "hull"),
    f"{ASSETS} --texture-format bmp": ("'bmp'", "ktx2"),
    f"{DEMO} --agent ghost": ("'ghost'", "keyboard"),
    f"{DEMO} --out out.gif": ("out.gif", ".mp4"),
    "check apartment --scenes v9": ("--simulate",),
    "convert . --out out.json": ("not a regular file",),
    "convert gone.json --out out.txt": ("out.txt", ".json.gz"),
    "epizodes": ("'epizodes'", "episodes"),
}
PLANNER = {
    "plan HabPick-v1": ("HabPick-v1", "HabSetTable-v1"),
    "plan HabSetTabel-v1": ("HabSetTable-v1",),
    "plan HabSetTable-v1 --out .": ("folder",),
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
    "publish environment": "out",
}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Everything relative is below an empty folder, and nothing may be left there."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def test_an_option_that_makes_no_sense_is_refused(elsewhere):
    def check(case):
        command, arguments, words = case
        refused_by_command(command, arguments, *words)
        assert not list(elsewhere.iterdir())

    cases = {line: (main, line.split(), words) for line, words in WORDS.items()}
    cases |= {line: (planner, line.split(), words) for line, words in PLANNER.items()}
    for line, option, values in NUMBERS:
        for value in values:
            cases[f"{line} {option} {value!r}"] = (main, [*line.split(), option, value], (option,))
    check_each(cases, check)


def test_what_may_not_be_replaced_stays(tmp_path, monkeypatch):
    """`tests/core/test_files.py` has what else can be no file or folder."""

    def lying_there():
        return {path: path.lstat()[:2] for path in Path().rglob("*")}

    def check(case):
        command, target = case
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        monkeypatch.chdir(folder)
        Path("file").write_text("precious")
        kind = Path(target)
        kind.mkdir() if kind.suffix else kind.write_text("precious")
        Path("mine/configs").mkdir(parents=True)
        Path("mine/configs/thesis.txt").write_text("precious")
        before = lying_there()
        mine = ("mine",) if command.startswith(("vary", "assets")) else ()
        for out in (f"file/{target}", target, f"a\0{target}", *mine):
            for force in ((), ("--force",)):
                arguments = [*command.split(), "--out", out, *force]
                refused_by_command(main, arguments, out[-3:])
                assert lying_there() == before

    writing = {name for name, made in COMMANDS.items() if "out" in made.__dataclass_fields__}
    assert {command.split()[0] for command in WRITES} == writing
    check_each({command: (command, target) for command, target in WRITES.items()}, check)
