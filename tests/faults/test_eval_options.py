"""Invalid options of `hab-eval`: one-line error, no output files."""

import os

import pytest
import stub_runs  # first: it finds the stub

import stub_hab  # isort: skip
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.reset import SUITE
from hab_eval.cli import COMMANDS, main
from hab_eval.config import EvalConfig
from hab_eval.evaluate import RunOptions
from hab_eval.results import write_record
from refusals import refused_by_call, refused_by_command
from stub_runs import RUN, make_record

from hab_tasks.cli import main as main_of_tasks
from hab_tasks.errors import HabError
from hab_tasks.options import parse_command

TEN_400 = str(10**400)


@pytest.fixture(autouse=True)
def stubbed():
    undo = stub_hab.install()
    yield
    undo()


NUMBERS = ["abc", "", " ", "1.5", "1e3", "0x10", "nan", "inf", "-inf", "1,000", "१२x", "1" * 5000]


@pytest.mark.parametrize("option", ["--episodes", "--seed", "--workers", "--video"])
@pytest.mark.parametrize("value", NUMBERS, ids=range(len(NUMBERS)))
def test_what_is_no_whole_number_is_one_line(tmp_path, option, value):
    refused_by_command(main, (*RUN, "--out", tmp_path / "run", f"{option}={value}"), option)
    assert not (tmp_path / "run").exists()


RANGES = {
    "episodes": ("0", "-1", "-" + TEN_400, TEN_400, "100001", "99999999999999999999"),
    "seed": ("-1", "-" + TEN_400, TEN_400, str(2**63)),
    "workers": ("0", "-1", "-" + TEN_400, TEN_400, "257", "99999999999999999999"),
    "video": ("-1", TEN_400, "99999999999999999999"),
    "step-timeout": ("0", "-1", "nan", "inf", "-inf", "1e400", "0.001", "1e9", "abc", "1 s", ""),
}


@pytest.mark.parametrize(
    ("option", "value"),
    [
        pytest.param(option, value, id=f"{option}-{number}")
        for option, values in RANGES.items()
        for number, value in enumerate(values)
    ],
)
def test_a_number_out_of_range_is_one_line_with_the_bound(tmp_path, option, value):
    arguments = (*RUN, "--out", tmp_path / "run", f"--{option}={value}")
    refused_by_command(main, arguments, option)
    assert not (tmp_path / "run").exists()


BENCH_RUN = ("bench", "--suite", "sim", "--json", "y", "--scene-dataset", "z")

WORDS = {
    "no_command": ((), "Expected one of", "run"),
    "command": (("rnu",), "'rnu'", "Did you mean 'run'?"),
    "command_case": (("RUN",), "'RUN'"),
    "command_empty": (("",), "''"),
    "missing": (("run", "--agent", "a:b"), "--env", "--out"),
    "missing_value": (("run", "--agent"), "--agent"),
    "stray": ((*RUN, "--out", "x", "stray"), "stray"),
    "flag_value": ((*RUN, "--out", "x", "--resume=3"), "3"),
    "no_flag": ((*RUN, "--out", "x", "--no-resume"), "--no-resume"),
    "typo": ((*RUN, "--out", "x", "--epsodes=3"), "'--epsodes=3'", "--episodes"),
    "env": (("run", "--agent", "a:b", "--env", "Hab\udc80", "--out", "x"), "env", "UTF-8"),
    "device": ((*RUN, "--out", "x", "--device", "tpu"), "'tpu'", "cpu"),
    "device_number": ((*RUN, "--out", "x", "--device", "cuda:99"), "'cuda:99'"),
    "device_empty": ((*RUN, "--out", "x", "--device", ""), "device"),
    "option_text": ((*RUN, "--out", "x", "--option", "speed"), "NAME=VALUE"),
    "option_surrogate": ((*RUN, "--out", "x", "--option", "file=\udcff.pt"), "file", "UTF-8"),
    "option_name_surrogate": ((*RUN, "--out", "x", "--option", "\udcff=1"), "UTF-8"),
    "agent_surrogate": (
        ("run", "--agent", "\udcff:x", "--env", "HabStub-v1", "--out", "x"),
        "agent",
    ),
    "both": ((*RUN, "--out", "x", "--resume", "--force"), "--resume", "--force"),
    "suite": (("bench", "--suite", "x", "--json", "y", "--scene-dataset", "z"), "'x'", "memory"),
    "repeats": ((*BENCH_RUN, "--repeats", "x"), "--repeats"),
    "no_runs": (("failures", "--out", "x.png"), "at least one run"),
    "format": (("failures", "run.json", "--out", "x.pdf"), ".png"),
    "no_submissions": (("table", "--submissions", "/nowhere"), "/nowhere"),
    "long_submissions": (("table", "--submissions", "x" * 5000), "submissions"),
}


@pytest.mark.parametrize("case", WORDS)
def test_bad_words_are_one_line(tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    arguments, *words = WORDS[case]
    refused_by_command(main, arguments, *words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_the_line_does_not_depend_on_what_the_terminal_can_draw(monkeypatch, encoding):
    import io
    import sys

    told = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", told)
        with pytest.raises(HabError) as caught:
            parse_command("hab-eval", COMMANDS, [*RUN, "--out", "x", "--seed", "abc"], "")
    expected = "Error parsing --seed: not a whole number: 'abc'. Help: hab-eval run --help"
    assert str(caught.value) == expected


TASKS = {
    "number": (("demo", "HabPick-v1", "--seed", "abc"), "--seed", "not a whole number"),
    "missing": (("episodes",), "--env", "--out"),
    "stray": (("list", "stray"), "stray"),
    "nothing": ((), "Expected one of"),
}


@pytest.mark.parametrize("case", TASKS)
def test_the_other_command_says_it_in_one_line_too(case):
    arguments, *words = TASKS[case]
    refused_by_command(main_of_tasks, arguments, *words, "hab-tasks", "--help")


BENCH = [{"repeats": 0}, {"repeats": -1}, {"repeats": 10**400}, {"repeats": 1.5}, {"repeats": "5"}]
BENCH += [{"steps": 0}, {"steps": 10**20}, {"steps": True}, {"envs": ("HabPick-v1",)}]


@pytest.mark.parametrize("options", BENCH, ids=range(len(BENCH)))
def test_numbers_of_a_bench_are_bounded(tmp_path, options):
    words = ["--env"] if "envs" in options else list(options)
    refused_by_call(lambda: BenchOptions(suite=SUITE, scene_dataset=tmp_path, **options), *words)


API = [{"episodes": 2.0}, {"episodes": "2"}, {"episodes": True}, {"episodes": None}, {"seed": None}]
API += [{"seed": 1.0}, {"options": {"a": "\ud800"}}, {"split": "\ud800"}, {"step_timeout_s": -1.0}]


@pytest.mark.parametrize("values", API, ids=range(len(API)))
def test_a_configuration_made_in_python_is_checked_too(values):
    field = next(iter(values)).partition("_")[0].removesuffix("s")
    refused_by_call(lambda: EvalConfig(agent="a:b", env="HabPick-v1", **values), field)


@pytest.mark.parametrize("values", [{"workers": None}, {"workers": 1.0}, {"videos": "1"}])
def test_options_of_a_run_made_in_python_are_checked_too(tmp_path, values):
    word = next(iter(values)).removesuffix("s")
    refused_by_call(lambda: RunOptions(out=tmp_path, **values), word)


def test_as_many_episodes_as_allowed_are_a_configuration():
    assert EvalConfig(agent="a:b", env="HabPick-v1", episodes=100_000, seed=2**63 - 1)


def place_of(tmp_path, case):
    """Returns a path at which nothing can be written."""
    (tmp_path / "file").write_text("precious")
    os.symlink(tmp_path / "nothing", tmp_path / "dangling")
    os.symlink(tmp_path / "loop", tmp_path / "loop")
    os.mkfifo(tmp_path / "pipe")
    return {
        "file": tmp_path / "file",
        "below_a_file": tmp_path / "file" / "run",
        "far_below_a_file": tmp_path / "file" / "a" / "b" / "run",
        "long": tmp_path / ("x" * 300),
        "long_path": tmp_path.joinpath(*["x" * 200] * 30),
        "nul": f"{tmp_path}/a\0b",
        "dangling": tmp_path / "dangling",
        "loop": tmp_path / "loop",
        "pipe": tmp_path / "pipe",
        "below_proc": "/proc/nothing/run",
    }[case]


PLACES = ["below_a_file", "far_below_a_file", "long", "long_path", "nul", "dangling", "loop"]
PLACES += ["pipe", "below_proc"]


def unchanged(tmp_path):
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["dangling", "file", "loop", "pipe", *names[4:]]
    assert (tmp_path / "file").read_text() == "precious"
    return names[4:]


@pytest.mark.parametrize("how", [(), ("--force",), ("--resume",)], ids=["new", "force", "resume"])
@pytest.mark.parametrize("case", ["file", *PLACES])
def test_a_folder_that_cannot_be_is_refused_before_anything_is_played(tmp_path, capfd, case, how):
    out = place_of(tmp_path, case)
    refusal = refused_by_command(main, (*RUN, "--episodes", 1, "--out", out, *how))
    assert "running" not in refusal.out
    assert unchanged(tmp_path) == []


@pytest.mark.parametrize("command", ["table", "failures", "bench"])
@pytest.mark.parametrize("case", PLACES)
def test_a_file_that_cannot_be_is_refused(tmp_path, command, case):
    out = place_of(tmp_path, case)
    runs = tmp_path / "runs"
    runs.mkdir()
    write_record(runs / "run.json", make_record())
    if command == "failures":
        out = out if case in ("pipe", "dangling", "loop") else f"{out}.png"
        out = tmp_path / "file" / "x.png" if not str(out).endswith(".png") else out
    commands = {
        "table": ("table", "--submissions", runs, "--out", out),
        "failures": ("failures", runs, "--out", out),
        "bench": ("bench", "--suite", "sim", "--scene-dataset", tmp_path, "--json", out),
    }
    refused_by_command(main, commands[command])
    assert unchanged(tmp_path) == ["runs"]


@pytest.mark.parametrize("out", [".", "..", "/"])
def test_a_folder_is_no_file_for_a_table(tmp_path, out):
    (tmp_path / "runs").mkdir()
    arguments = ("table", "--submissions", tmp_path / "runs", "--out", out)
    refused_by_command(main, arguments, "is a folder; give")


def test_the_page_cannot_take_the_place_of_the_table(tmp_path):
    arguments = ("table", "--submissions", tmp_path, "--out", tmp_path / "x.html")
    refused_by_command(main, arguments, "x.html", ".md")
    assert list(tmp_path.iterdir()) == []


FULL = os.path.exists("/dev/full")


@pytest.mark.skipif(not FULL, reason="no /dev/full, which stands for a disk without room")
@pytest.mark.parametrize(
    "name", ["episodes.jsonl", pytest.param("traces.jsonl", marks=pytest.mark.slow)]
)
def test_a_disk_that_fills_in_mid_run_keeps_what_is_there(tmp_path, capfd, monkeypatch, name):
    out = tmp_path / "run"
    agent = ("run", "--agent", "stub_hab:telling", "--env", "HabStub-v1", "--episodes", 4)
    arguments = [*map(str, agent), "--out", str(out)]
    from hab_eval import run_folder

    write, count = run_folder._add_line, iter(range(100))

    def filling(path, value):
        if path.name == name and next(count) == 2:
            with open("/dev/full", "a") as full, monkeypatch.context() as patch:
                patch.setattr(type(path), "open", lambda *_, **__: full)
                write(path, value)
        write(path, value)

    with monkeypatch.context() as patch:
        patch.setattr(run_folder, "_add_line", filling)
        assert main(arguments) == 1
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert all(w in lines[0] for w in (name, "No space left on device", "of 4", "--resume"))
    assert main([*arguments, "--resume"]) == 0
    assert len(stub_runs.journal_ids(out)) == len(set(stub_runs.journal_ids(out))) == 4
    assert len(stub_runs.results_of(out)) == 4
