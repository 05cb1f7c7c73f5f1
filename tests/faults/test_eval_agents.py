"""Agents that violate the protocol: a one-line error that names the agent and the violation."""

import importlib
import sys

import pytest
import stub_runs  # first: it finds the stub

import faulty_agents  # isort: skip
import stub_hab
from faulty_agents import ACTIONS, REPORTS, SPECS
from hab_eval.agent_checks import check_report
from hab_eval.cli import main
from hab_eval.errors import AgentError
from hab_eval.load_agent import load_agent
from hab_eval.runner import run_episode
from refusals import check_each, check_words, refused_by_command
from stub_runs import FAULTY, journal_ids

from hab_tasks.agent import AgentReport, AgentSetup

EXIT_STOPPED = 1


pytestmark = pytest.mark.usefixtures("stubbed")


def setup_of(case):
    return AgentSetup(env_id="HabStub-v1", options={"case": case})


def stopped_line(capfd, out, *arguments):
    """Runs; asserts exit 1 and one line on stderr, and returns that line."""
    capfd.readouterr()
    code = main([*map(str, arguments), "--out", str(out)])
    lines = capfd.readouterr().err.splitlines()
    assert code == EXIT_STOPPED, lines
    assert len(lines) == 1, lines
    check_words(lines[0], ("hab-eval: ", "--resume"))
    assert "run.json" not in [path.name for path in out.iterdir()]
    return lines[0]


def stopped_with(capfd, tmp_path, case, *words):
    """Runs two episodes of a faulty agent; returns the folder after the error line was checked."""
    out = tmp_path / f"run-{case}"
    arguments = (*FAULTY, "--option", f"case={case}", "--episodes", 2)
    check_words(stopped_line(capfd, out, *arguments), words)
    return out


def test_a_bad_spec_is_named_before_anything_is_made(tmp_path):
    out = tmp_path / "run"

    def check(case):
        field = next(iter(SPECS.get(case, ["is null"])))
        arguments = (*FAULTY, "--option", f"case=spec:{case}", "--out", out)
        words = ("spec is null", "AgentSpec") if case == "none" else (field,)
        refused_by_command(main, arguments, *words)
        assert not out.exists()

    check_each({case: case for case in (*SPECS, "none")}, check)


def test_a_bad_report_or_action_is_named():
    def check(case):
        kind, _, name = case.partition(":")
        field = name.partition("_")[0]
        field = field if field in ("failure", "timings", "doing", "trace") else "report()"
        words = (field, "report()") if kind == "report" else ("act() must return",)
        agent = load_agent("faulty_agents:made", setup_of(case))
        episode = stub_hab.StubEpisode(id="e", scene_id="s", seed=0)
        with pytest.raises(AgentError) as caught:
            run_episode(stub_hab.StubEnv(render=False), agent, 0, episode)
        check_words(str(caught.value), words)

    cases = [*(f"report:{name}" for name in REPORTS), *(f"act:{name}" for name in ACTIONS)]
    check_each({case: case for case in cases}, check)


def test_a_bad_report_or_action_stops_the_run(tmp_path, capfd):
    for case, word in (("report:none", "Stub: "), ("act:none", "act() must return")):
        stopped_with(capfd, tmp_path, case, "'stub/000'", word)


ERRORS = {
    "exit": "sys.exit(0)",
    "exit_none": "sys.exit(None)",
    "exit_text": "sys.exit('done')",
    "value": "ValueError: three lines of it",
    "key": "KeyError: 'missing'",
    "memory": "MemoryError",
    "recursion": "RecursionError: too deep",
    "long": "RuntimeError: xxx",
    "control": r"RuntimeError: \x1b[31mred",
}


@pytest.mark.slow
def test_a_method_that_raises_or_exits_stops_the_run_and_keeps_what_is_done(tmp_path, capfd):
    """Each error in one method, and each method with one."""

    def check(case):
        name = case.rpartition(":")[2]
        words = ("Episode 'stub/001' stopped the run", ERRORS[name], "1 of 2 episodes")
        out = stopped_with(capfd, tmp_path, f"raise:{case}", *words)
        assert journal_ids(out) == ["stub/000"]

    cases = [*(f"act:{case}" for case in ERRORS), "reset:exit", "reset:value", "report:value"]
    check_each({case: case for case in cases}, check)


def test_a_factory_that_raises_is_named_with_file_and_line(tmp_path):
    def check(case):
        arguments = (*FAULTY, "--option", f"case=factory:{case}", "--out", tmp_path / "run")
        words = ("factory of agent 'faulty_agents:made' raised", ERRORS.get(case, "StopIteration"))
        refused_by_command(main, arguments, *words)
        assert not (tmp_path / "run").exists()

    check_each({case: case for case in ("value", "memory", "recursion", "long", "stop")}, check)


def test_what_is_no_agent_is_named(tmp_path):
    def check(case):
        arguments = (*FAULTY, "--option", f"case=factory:{case}", "--out", tmp_path / "run")
        wanted = "no spec today" if case == "guarded" else "it needs spec, reset, act and report"
        refused_by_command(main, arguments, "faulty_agents:made", wanted)

    cases = ("nothing", "class", "absent", "halved", "guarded")
    check_each({case: case for case in cases}, check)


def test_a_factory_that_exits_is_no_success(tmp_path, capfd):
    code = main([*FAULTY, "--option", "case=factory:exit", "--out", str(tmp_path / "run")])
    lines = capfd.readouterr().err.splitlines()
    assert (code, len(lines)) == (EXIT_STOPPED, 1)
    check_words(lines[0], ("factory of agent 'faulty_agents:made'", "sys.exit(0)"))


MODULES = {
    "syntax": ("def agent(setup:\n", "SyntaxError", "line 1"),
    "bytes": (b"x = '\xff'\n", "SyntaxError", "utf-8"),
    "name": ("agent = missing\n", "NameError", "line 1"),
    "raises": ("\nraise RuntimeError('no weights')\n", "no weights", "line 2"),
    "import": ("from hab_tasks import nothing_such\n", "cannot be imported", "nothing_such"),
    "needs": ("import surely_not_there\n", "needs 'surely_not_there'", "not installed"),
    "deep": ("x = " + "(" * 300 + ")" * 300 + "\n", "raised", "parenthes"),
}


def test_a_module_that_cannot_be_imported_is_named(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)

    def check(case):
        source, *words = MODULES[case]
        name = f"bad_module_{case}"
        source = source.encode() if isinstance(source, str) else source
        (tmp_path / f"{name}.py").write_bytes(source)
        importlib.invalidate_caches()
        arguments = ("run", "--agent", f"{name}:agent", "--env", "HabStub-v1")
        refused_by_command(main, (*arguments, "--out", tmp_path / "run"), name, *words)
        assert not (tmp_path / "run").exists()

    check_each({case: case for case in MODULES}, check)


def test_a_module_that_exits_is_no_success(tmp_path, monkeypatch, capfd):
    (tmp_path / "exiting_module.py").write_text("import sys\nsys.exit(0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    arguments = ["run", "--agent", "exiting_module:agent", "--env", "HabStub-v1"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == EXIT_STOPPED
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    check_words(lines[0], ("'exiting_module' called sys.exit(0)", "line 2"))
    assert not (tmp_path / "run").exists()


REFERENCES = ["", ":", "x", "x:", ":x", "..x:y", "stub_hab.x:y", "a b:c", "hab_eval..x:y"]
REFERENCES += ["stub_hab:a.b", "stub_hab:constant:x", "nul\0:x", "é" * 500 + ":x"]


def test_a_bad_reference_is_one_line(tmp_path):
    def check(reference):
        arguments = ("run", "--agent", reference, "--env", "HabStub-v1", "--out", tmp_path / "run")
        refused_by_command(main, arguments, "gent")
        assert not (tmp_path / "run").exists()

    check_each({reference[:20]: reference for reference in REFERENCES}, check)


@pytest.mark.slow
def test_an_exit_in_a_worker_is_told_as_in_one_process(tmp_path):
    out = tmp_path / "run"
    arguments = (*FAULTY, "--option", "case=raise:act:exit", "--episodes", 3, "--workers", 2)
    process = stub_runs.start(*arguments, "--out", out)
    _, err = process.communicate(timeout=60)
    assert process.returncode == EXIT_STOPPED
    assert len(err.splitlines()) == 1, err
    check_words(err, ("Episode 'stub/001' stopped the run", "sys.exit(0)", "--resume"))
    assert "stub/001" not in (journal_ids(out) if (out / "episodes.jsonl").exists() else [])


def test_numbers_of_other_libraries_are_durations():
    import numpy as np
    import torch

    report = AgentReport(timings_s={"a": np.float32(0.5), "b": torch.tensor(2.0), "c": 3})
    assert check_report(report, "x") == (None, {"a": 0.5, "b": 2.0, "c": 3.0})


def test_good_agents_still_load():
    setup = setup_of("report:none")
    assert load_agent("faulty_agents:made", setup)
    assert faulty_agents.__name__ in sys.modules
    with pytest.raises(AgentError, match="not a hab_tasks"):
        load_agent("stub_hab:not_an_agent", setup)
