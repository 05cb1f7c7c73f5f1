"""Invalid options of `hab-eval`: one-line error, no output files."""

import io
import itertools
import os
import sys

import pytest
import stub_runs  # first: it finds the stub
from hab_eval import run_folder
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.reset import SUITE
from hab_eval.cli import COMMANDS, main
from hab_eval.config import EvalConfig
from hab_eval.evaluate import RunOptions
from hab_eval.results import write_record
from refusals import check_each, refused_by_call, refused_by_command
from stub_runs import RUN, make_record

from hab_tasks.cli import main as main_of_tasks
from hab_tasks.errors import HabError
from hab_tasks.options import parse_command

TEN_400 = str(10**400)


pytestmark = pytest.mark.usefixtures("stubbed")


NUMBERS = {
    "episodes": ("abc", "", " ", "1.5", "1e3", "0x10", "nan", "1,000", "1" * 5000, "0", "100001"),
    "seed": ("abc", "-1", "-" + TEN_400, TEN_400, str(2**63)),
    "workers": ("abc", "0", "-1", "257", TEN_400),
    "video": ("abc", "-1", "99999999999999999999"),
    "step-timeout": ("0", "-1", "nan", "inf", "1e400", "0.001", "1e9", "abc", ""),
}


def test_a_number_that_is_none_or_out_of_range_is_one_line(tmp_path):
    def check(case):
        option, value = case
        refused_by_command(main, (*RUN, "--out", tmp_path / "run", f"--{option}={value}"), option)
        assert not (tmp_path / "run").exists()

    cases = [(option, value) for option, values in NUMBERS.items() for value in values]
    check_each({f"{option}={value}"[:40]: (option, value) for option, value in cases}, check)


BENCH_RUN = ("bench", "--suite", "sim", "--json", "y", "--scene-dataset", "z")

WORDS = {
    "no_command": ((), "Expected one of", "run"),
    "command": (("rnu",), "'rnu'", "Did you mean 'run'?"),
    "missing": (("run", "--agent", "a:b"), "--env", "--out"),
    "missing_value": (("run", "--agent"), "--agent"),
    "stray": ((*RUN, "--out", "x", "stray"), "stray"),
    "no_flag": ((*RUN, "--out", "x", "--no-resume"), "--no-resume"),
    "typo": ((*RUN, "--out", "x", "--epsodes=3"), "'--epsodes=3'", "--episodes"),
    "env": (("run", "--agent", "a:b", "--env", "Hab\udc80", "--out", "x"), "env", "UTF-8"),
    "device": ((*RUN, "--out", "x", "--device", "tpu"), "'tpu'", "cpu"),
    "option_text": ((*RUN, "--out", "x", "--option", "speed"), "NAME=VALUE"),
    "option_surrogate": ((*RUN, "--out", "x", "--option", "file=\udcff.pt"), "file", "UTF-8"),
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


def test_bad_words_are_one_line(tmp_path, monkeypatch):
    def check(case):
        arguments, *words = case
        refused_by_command(main, arguments, *words)
        assert list(tmp_path.iterdir()) == []

    monkeypatch.chdir(tmp_path)
    check_each(WORDS, check)


def test_the_line_does_not_depend_on_what_the_terminal_can_draw(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding="ascii"))
        with pytest.raises(HabError) as caught:
            parse_command("hab-eval", COMMANDS, [*RUN, "--out", "x", "--seed", "abc"], "")
    expected = "Error parsing --seed: not a whole number: 'abc'. Help: hab-eval run --help"
    assert str(caught.value) == expected


def test_the_other_command_says_it_in_one_line_too():
    arguments = ("demo", "HabPick-v1", "--seed", "abc")
    refused_by_command(main_of_tasks, arguments, "--seed", "a whole number", "hab-tasks", "--help")


BENCH = [{"repeats": 0}, {"repeats": 10**400}, {"repeats": 1.5}, {"repeats": "5"}]
BENCH += [{"steps": 0}, {"steps": True}, {"envs": ("HabPick-v1",)}]
API = [{"episodes": 2.0}, {"episodes": "2"}, {"episodes": True}, {"seed": None}, {"seed": 1.0}]
API += [{"options": {"a": "\ud800"}}, {"split": "\ud800"}, {"step_timeout_s": -1.0}]


def test_options_made_in_python_are_checked_too(tmp_path):
    def bench(options):
        words = ["--env"] if "envs" in options else list(options)
        made = {"suite": SUITE, "scene_dataset": tmp_path, **options}
        refused_by_call(lambda: BenchOptions(**made), *words)

    def configuration(values):
        field = next(iter(values)).partition("_")[0].removesuffix("s")
        refused_by_call(lambda: EvalConfig(agent="a:b", env="HabPick-v1", **values), field)

    def of_run(values):
        word = next(iter(values)).removesuffix("s")
        refused_by_call(lambda: RunOptions(out=tmp_path, **values), word)

    check_each({repr(options)[:60]: options for options in BENCH}, bench)
    check_each({repr(values)[:60]: values for values in API}, configuration)
    check_each({"workers": {"workers": None}, "videos": {"videos": "1"}}, of_run)


def test_as_many_episodes_as_allowed_are_a_configuration():
    assert EvalConfig(agent="a:b", env="HabPick-v1", episodes=100_000, seed=2**63 - 1)


@pytest.fixture
def places(tmp_path):
    """Paths at which nothing can be written."""
    (tmp_path / "file").write_text("precious")
    os.symlink(tmp_path / "nothing", tmp_path / "dangling")
    os.symlink(tmp_path / "loop", tmp_path / "loop")
    os.mkfifo(tmp_path / "pipe")
    yield {
        "below a file": tmp_path / "file" / "a" / "run",
        "long": tmp_path / ("x" * 300),
        "long path": tmp_path.joinpath(*["x" * 200] * 30),
        "nul": f"{tmp_path}/a\0b",
        "dangling": tmp_path / "dangling",
        "loop": tmp_path / "loop",
        "pipe": tmp_path / "pipe",
        "below proc": "/proc/nothing/run",
    }
    names = {path.name for path in tmp_path.iterdir()}
    assert names - {"runs"} == {"dangling", "file", "loop", "pipe"}
    assert (tmp_path / "file").read_text() == "precious"


def test_a_folder_that_cannot_be_is_refused_before_anything_is_played(tmp_path, places):
    def check(case):
        out, how = case
        refusal = refused_by_command(main, (*RUN, "--episodes", 1, "--out", out, *how))
        assert "running" not in refusal.out

    folders = places | {"file": tmp_path / "file"}
    cases = {name: (out, ()) for name, out in folders.items()}
    cases |= {f"{name} --force": (out, ("--force",)) for name, out in folders.items()}
    check_each(cases | {"file --resume": (tmp_path / "file", ("--resume",))}, check)


def test_a_file_that_cannot_be_is_refused(tmp_path, places):
    runs = tmp_path / "runs"
    runs.mkdir()
    write_record(runs / "run.json", make_record())
    pictures = {name: places[name] for name in ("dangling", "loop", "pipe")}
    pictures["below a file"] = tmp_path / "file" / "x.png"
    bench = ("bench", "--suite", "sim", "--scene-dataset", tmp_path, "--json")
    for command, outs in (
        (("table", "--submissions", runs, "--out"), places),
        (("failures", runs, "--out"), pictures),
        (bench, places),
    ):
        check_each(outs, lambda out, command=command: refused_by_command(main, (*command, out)))


def test_a_folder_is_no_file_for_a_table(tmp_path):
    (tmp_path / "runs").mkdir()
    arguments = ("table", "--submissions", tmp_path / "runs", "--out", tmp_path)
    refused_by_command(main, arguments, "is a folder; give")


def test_the_page_cannot_take_the_place_of_the_table(tmp_path):
    arguments = ("table", "--submissions", tmp_path, "--out", tmp_path / "x.html")
    refused_by_command(main, arguments, "x.html", ".md")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full, a disk without room")
@pytest.mark.parametrize(
    "name", ["episodes.jsonl", pytest.param("traces.jsonl", marks=pytest.mark.slow)]
)
def test_a_disk_that_fills_in_mid_run_keeps_what_is_there(tmp_path, capfd, monkeypatch, name):
    out = tmp_path / "run"
    agent = ("run", "--agent", "stub_hab:telling", "--env", "HabStub-v1", "--episodes", "4")
    arguments = [*agent, "--out", str(out)]
    write, count = run_folder._add_line, itertools.count()

    def filling(path, value):
        if path.name == name and next(count) == 2:
            with open("/dev/full", "a") as full, monkeypatch.context() as patch:
                patch.setattr(type(path), "open", lambda *_, **__: full)
                write(path, value)
        write(path, value)

    with monkeypatch.context() as patch:
        patch.setattr(run_folder, "_add_line", filling)
        assert main(arguments) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert all(w in line for w in (name, "No space left on device", "of 4", "--resume"))
    assert main([*arguments, "--resume"]) == 0
    assert len(set(stub_runs.journal_ids(out))) == len(stub_runs.results_of(out)) == 4
