"""Agents that violate the protocol: a one-line error that names the agent and the violation."""

import importlib

import pytest
import stub_hab
import torch
from faulty_agents import ACTIONS, REPORTS, SPECS
from hab_eval.cli import main
from hab_eval.run.agents import load_agent
from hab_eval.run.runner import run_episode
from refusals import check_each, check_words, refused_by_call, refused_by_command
from stub_runs import FAULTY, journal_ids

from hab_tasks.agent import AgentSetup

EXIT_STOPPED = 1

pytestmark = pytest.mark.usefixtures("stubbed")


def stopped_line(capfd, out, *arguments):
    """Runs; asserts exit 1 and one line on stderr, and returns that line."""
    capfd.readouterr()
    code = main([*map(str, arguments), "--out", str(out)])
    lines = capfd.readouterr().err.splitlines()
    assert (code, len(lines)) == (EXIT_STOPPED, 1), lines
    assert not (out / "run.json").exists()
    return lines[0]


def test_a_bad_spec_is_named_before_anything_is_made(tmp_path):
    def check(case):
        arguments = (*FAULTY, "--option", f"case=spec:{case}", "--out", tmp_path / "run")
        refused_by_command(main, arguments, next(iter(SPECS.get(case, ["spec is null"]))))
        assert not (tmp_path / "run").exists()

    check_each({case: case for case in (*SPECS, "none")}, check)


def played(agent):
    episode = stub_hab.StubEpisode(id="e", scene_id="s", seed=0)
    return lambda: run_episode(stub_hab.StubEnv(render=False), agent, 0, episode)


def test_a_bad_report_or_action_is_named():
    def check(case):
        kind, _, name = case.partition(":")
        field = name.partition("_")[0]
        field = field if field in ("failure", "timings", "doing", "trace") else "report()"
        words = (field, "report()") if kind == "report" else ("act() must return",)
        setup = AgentSetup(env_id="HabStub-v1", options={"case": case})
        refused_by_call(played(load_agent("faulty_agents:made", setup)), *words)

    cases = [*(f"report:{name}" for name in REPORTS), *(f"act:{name}" for name in ACTIONS)]
    check_each({case: case for case in cases}, check)
    agent = stub_hab.StubAgent()
    agent.act = lambda obs: torch.full((1, 2), 0.5, requires_grad=True)
    assert played(agent)().episode.steps > 0
    agent.act = lambda obs: torch.full((1, 2), torch.inf)  # the stub's reward is its mean
    refused_by_call(played(agent), "return", "finite")


ERRORS = {
    "exit": "sys.exit(0)",
    "value": "ValueError: three lines of it",
    "long": "RuntimeError: xxx",
    "control": r"RuntimeError: \x1b[31mred",
}

FACTORIES = {
    "value": "raised ValueError: three lines of it",
    "stop": "raised StopIteration",
    "guarded": "no spec today",
    **dict.fromkeys(("nothing", "absent", "halved"), "it needs spec, reset, act and report"),
}


@pytest.mark.slow
def test_a_method_that_raises_or_exits_stops_the_run_and_keeps_what_is_done(tmp_path, capfd):
    """Each error in one method, and each method with one."""

    def check(case):
        out = tmp_path / case
        arguments = (*FAULTY, "--option", f"case=raise:{case}", "--episodes", 2)
        line = stopped_line(capfd, out, *arguments)
        error = ERRORS[case.rpartition(":")[2]]
        check_words(line, ("Episode 'stub/001' stopped", error, "1 of 2 episodes", "--resume"))
        assert journal_ids(out) == ["stub/000"]

    cases = [*(f"act:{case}" for case in ERRORS), "reset:exit", "report:value"]
    check_each({case: case for case in cases}, check)


def test_a_factory_that_raises_or_makes_no_agent_is_named(tmp_path):
    def check(case):
        arguments = (*FAULTY, "--option", f"case=factory:{case}", "--out", tmp_path / "run")
        refused_by_command(main, arguments, "faulty_agents:made", FACTORIES[case])
        assert not (tmp_path / "run").exists()

    check_each({case: case for case in FACTORIES}, check)


MODULES = {
    "syntax": (b"def agent(setup:\n", "SyntaxError", "line 1"),
    "raises": (b"\nraise RuntimeError('no weights')\n", "no weights", "line 2"),
    "import": (b"from hab_tasks import nothing_such\n", "cannot be imported", "nothing_such"),
    "needs": (b"import surely_not_there\n", "needs 'surely_not_there'", "not installed"),
}


def test_a_module_that_cannot_be_imported_is_named(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)

    def check(case):
        source, *words = MODULES[case]
        name = f"bad_module_{case}"
        (tmp_path / f"{name}.py").write_bytes(source)
        importlib.invalidate_caches()
        arguments = ("run", "--agent", f"{name}:agent", "--env", "HabStub-v1")
        refused_by_command(main, (*arguments, "--out", tmp_path / "run"), name, *words)
        assert not (tmp_path / "run").exists()

    check_each({case: case for case in MODULES}, check)


def test_a_module_or_factory_that_exits_is_no_success(tmp_path, monkeypatch, capfd):
    out = tmp_path / "run"
    line = stopped_line(capfd, out, *FAULTY, "--option", "case=factory:exit")
    check_words(line, ("factory of agent 'faulty_agents:made'", "sys.exit(0)"))
    (tmp_path / "exiting_module.py").write_text("import sys\nsys.exit(0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    arguments = ("run", "--agent", "exiting_module:agent", "--env", "HabStub-v1")
    line = stopped_line(capfd, out, *arguments)
    check_words(line, ("'exiting_module' called sys.exit(0)", "line 2"))
    assert not out.exists()


def test_a_bad_reference_is_one_line(tmp_path):
    def check(reference):
        arguments = ("run", "--agent", reference, "--env", "HabStub-v1", "--out", tmp_path / "run")
        refused_by_command(main, arguments, "gent")
        assert not (tmp_path / "run").exists()

    references = ("", ":x", "..x:y", "a b:c", "hab_eval..x:y", "nul\0:x", "é" * 500 + ":x")
    check_each({reference[:20]: reference for reference in references}, check)
