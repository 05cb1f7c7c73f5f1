"""Invalid options of `hab-eval`: one-line error, no output files."""

import itertools
import os
from functools import partial

import pytest
import stub_runs  # first: it finds the stub
from hab_eval import run_folder
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.reset import SUITE
from hab_eval.cli import main
from hab_eval.config import EvalConfig
from hab_eval.evaluate import RunOptions
from hab_eval.results import write_record
from refusals import check_each, refused_by_call, refused_by_command
from stub_runs import RUN, make_record

pytestmark = pytest.mark.usefixtures("stubbed")

NUMBERS = {
    "episodes": ("abc", "", "1.5", "0x10", "1,000", "1" * 5000, "0", "100001"),
    "seed": ("-1", str(2**63)),
    "workers": ("0", "257"),
    "step-timeout": ("0", "nan", "inf", "0.001", "1e9", "abc", ""),
}


def test_a_number_that_is_none_or_out_of_range_is_one_line(tmp_path):
    def check(case):
        option, value = case
        refused_by_command(main, (*RUN, "--out", tmp_path / "run", f"--{option}={value}"), option)
        assert not (tmp_path / "run").exists()

    cases = [(option, value) for option, values in NUMBERS.items() for value in values]
    check_each({f"{option}={value}"[:40]: (option, value) for option, value in cases}, check)


WORDS = {
    "no_command": ((), "Expected one of", "run"),
    "missing": (("run", "--agent", "a:b"), "--env", "--out"),
    "stray": ((*RUN, "--out", "x", "stray"), "stray"),
    "typo": ((*RUN, "--out", "x", "--epsodes=3"), "'--epsodes=3'", "--episodes"),
    "env": (("run", "--agent", "a:b", "--env", "Hab\udc80", "--out", "x"), "env", "UTF-8"),
    "device": ((*RUN, "--out", "x", "--device", "tpu"), "'tpu'", "cpu"),
    "option_text": ((*RUN, "--out", "x", "--option", "speed"), "NAME=VALUE"),
    "both": ((*RUN, "--out", "x", "--resume", "--force"), "--resume", "--force"),
    "suite": (("bench", "--suite", "x", "--json", "y", "--scene-dataset", "z"), "'x'", "memory"),
    "no_runs": (("failures", "--out", "x.png"), "at least one run"),
    "format": (("failures", "run.json", "--out", "x.pdf"), ".png"),
    "no_submissions": (("table", "--submissions", "/nowhere"), "/nowhere"),
    "page": (("table", "--submissions", ".", "--out", "x.html"), "x.html", ".md"),
    "folder": (("table", "--submissions", ".", "--out", "."), "is a folder; give"),
}


def test_bad_words_are_one_line(tmp_path, monkeypatch):
    def check(case):
        arguments, *words = case
        refused_by_command(main, arguments, *words)
        assert list(tmp_path.iterdir()) == []

    monkeypatch.chdir(tmp_path)
    check_each(WORDS, check)


def test_options_made_in_python_are_checked_too(tmp_path):
    def check(case):
        make, option = case
        refused_by_call(lambda: make(**option), next(iter(option)).partition("_")[0])

    bench = partial(BenchOptions, suite=SUITE, scene_dataset=tmp_path)
    config = partial(EvalConfig, agent="a:b", env="HabPick-v1")
    run = partial(RunOptions, out=tmp_path)
    cases = [(bench, {"repeats": 1.5}), (bench, {"steps": True}), (config, {"episodes": 2.0})]
    cases += [(config, {"seed": None}), (config, {"split": "\ud800"}), (run, {"workers": None})]
    check_each({ascii(case[1]): case for case in cases}, check)


@pytest.fixture
def places(tmp_path):
    """Paths at which nothing can be written; `tests/core/test_files.py` has all of them."""
    (tmp_path / "file").write_text("precious")
    os.mkfifo(tmp_path / "pipe")
    yield {
        "below a file": tmp_path / "file" / "x.png",
        "long path": tmp_path.joinpath(*["x" * 200] * 30) / "x.png",
        "nul": f"{tmp_path}/a\0b.png",
        "pipe": tmp_path / "pipe",
    }
    assert {path.name for path in tmp_path.iterdir()} - {"runs"} == {"file", "pipe"}
    assert (tmp_path / "file").read_text() == "precious"


def test_a_folder_that_cannot_be_is_refused_before_anything_is_played(tmp_path, places):
    def check(out):
        for how in ((), ("--force",)):
            refusal = refused_by_command(main, (*RUN, "--episodes", 1, "--out", out, *how))
            assert "running" not in refusal.out

    check_each(places | {"file": tmp_path / "file"}, check)
    refused_by_command(main, (*RUN, "--out", tmp_path / "file", "--resume"))


def test_a_file_that_cannot_be_is_refused(tmp_path, places):
    runs = tmp_path / "runs"
    runs.mkdir()
    write_record(runs / "run.json", make_record())

    def check(out):
        refused_by_command(main, ("table", "--submissions", runs, "--out", out))
        refused_by_command(main, ("failures", runs, "--out", out))
        bench = ("bench", "--suite", "sim", "--scene-dataset", tmp_path)
        refused_by_command(main, (*bench, "--json", out))

    check_each(places, check)


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
