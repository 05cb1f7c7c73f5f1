"""Invalid options of `hab-eval`: one-line error, no output files."""

import itertools
import os

import pytest
import stub_runs  # first: it finds the stub
from hab_eval.cli import main
from hab_eval.records.results import write_record
from hab_eval.run import run_folder
from refusals import check_each, refused_by_command
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
    "missing": (("run", "--agent", "a:b"), "--env", "--out"),
    "typo": ((*RUN, "--out", "x", "--epsodes=3"), "'--epsodes=3'", "--episodes"),
    "env": (("run", "--agent", "a:b", "--env", "Hab\udc80", "--out", "x"), "env", "UTF-8"),
    "device": ((*RUN, "--out", "x", "--device", "tpu"), "'tpu'", "cpu"),
    "no_gpu": ((*RUN, "--out", "x", "--device", "cuda:9"), "'cuda:9' is not available", "cpu"),
    "option_text": ((*RUN, "--out", "x", "--option", "speed"), "NAME=VALUE"),
    "both": ((*RUN, "--out", "x", "--resume", "--force"), "--resume", "--force"),
    "suite": (
        ("bench", "--suite", "x", "--json", "y", "--scene-dataset", "z"),
        "'x'",
        "regressions",
    ),
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


def test_where_nothing_can_be_written_is_refused_before_anything_is_done(tmp_path):
    """`tests/core/test_files.py` has all such places."""
    (tmp_path / "file").write_text("precious")
    os.mkfifo(tmp_path / "pipe")
    record, before = tmp_path / "run.json", {"run.json", "file", "pipe"}
    write_record(record, make_record())

    def check(name):
        out = f"{tmp_path}/{name}"
        for how in ((), ("--force",)):
            refusal = refused_by_command(main, (*RUN, "--episodes", 1, "--out", out, *how))
            assert "running" not in refusal.out
        refused_by_command(main, ("table", "--submissions", tmp_path, "--out", out))
        refused_by_command(main, ("failures", record, "--out", out))
        bench = ("bench", "--suite", "sim", "--scene-dataset", tmp_path)
        refused_by_command(main, (*bench, "--json", out))
        assert {path.name for path in tmp_path.iterdir()} == before

    names = ("file/x.png", f"{'x' * 300}/x.png", "a\0b.png", "pipe")
    check_each({name[:20]: name for name in names}, check)
    for how in ((), ("--force",), ("--resume",)):
        refused_by_command(main, (*RUN, "--out", tmp_path / "file", *how))
    assert (tmp_path / "file").read_text() == "precious"


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
