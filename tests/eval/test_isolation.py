"""`hab-eval run --isolated`: agents in processes without environment, evaluator and seed."""

import pytest
from hab_eval.records.results import read_record
from refusals import check_each
from stub_runs import RUN, results_of, traces_of

EPISODES = ("--env", "HabStub-v1", "--seed", 3, "--episodes", 3)


@pytest.mark.slow
def test_cheats_of_the_process_fail_in_isolation(cli, cli_process, tmp_path):
    def results(run, agent, *options):
        out = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        done = run("run", "--agent", agent, *EPISODES, *options, "--out", out)
        assert done.returncode == 0, done.stderr
        assert read_record(out / "run.json").isolated == ("--isolated" in options)
        return results_of(out)

    honest = results(cli, "stub_hab:constant", "--isolated")
    assert [one["success"] for one in honest] == [True, False, False]
    for agent, workers in (("patching", 1), ("finding", 2)):
        command = (cli_process, f"cheating_agents:{agent}", "--workers", workers)
        assert all(one["success"] for one in results(*command))
        assert results(*command, "--isolated") == honest
    results(cli, "cheating_agents:reading", "--isolated")
    (file,) = tmp_path.glob("*/traces.jsonl")
    assert list(traces_of(file.parent).values()) == [[{"argv": []}]] * 3


REFUSED = (
    ("cheating_agents:sending", "cheating_agents:sending sent no JSON"),
    ("cheating_agents:keeping", "can be read only until the next step"),
    ("stub_hab:raising", "ZeroDivisionError: three is too many"),
    ("stub_hab:absent", "Unknown agent in stub_hab 'absent'"),
    ("stub_hab:", "Unknown agent in stub_hab ''"),
    ("faulty_agents:made", "raised KeyError: 'case'"),
)


def test_errors_are_those_of_an_agent_in_the_same_process(cli, tmp_path):
    def check(case):
        agent, message = case
        done = cli("run", "--agent", agent, *EPISODES, "--isolated", "--out", tmp_path / agent)
        assert done.returncode in (1, 2)
        assert message in done.stderr
        assert "Traceback" not in done.stderr

    check_each({case[0]: case for case in REFUSED}, check)
    ray = (*RUN, "--isolated", "--executor", "ray", "--out", tmp_path / "ray")
    assert "needs --executor local" in cli(*ray).stderr


@pytest.mark.slow
def test_the_process_of_a_late_agent_ends(cli_process, tmp_path):
    command = ("run", "--agent", "faulty_agents:made", *EPISODES, "--isolated")
    command += ("--option", "case=late:act:deaf", "--step-timeout", 1, "--out", tmp_path / "late")
    done = cli_process(*command)
    assert done.returncode == 0, done.stderr
    failures = [one["failure"] for one in results_of(tmp_path / "late")]
    assert failures == [None, "agent timeout", "timeout"]
