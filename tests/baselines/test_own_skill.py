"""A skill inside tasks from another package: opening a cabinet's door (`tests/my_kitchen`)."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
# New Pythons: the package adds a handle and a receptacle to the tables of the one that imports it.
PLANS = """
import my_kitchen
from hab_plans import plan_of, problem_of
from hab_plans.solve import replay, solve
problem = problem_of("ClearCabinet-v1")
for plan in (plan_of("ClearCabinet-v1"), solve(problem)):
    assert replay(problem, plan)[-1] == problem.goal
    assert [action.skill for action in plan.interactions] == ["open_cabinet", "pick", "place"]
assert plan_of("ClearCabinet-v1").interactions[0].name == "open-cabinet"
"""


def run(*command):
    done = subprocess.run([sys.executable, *command], cwd=TESTS, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_its_action_is_planned():
    run("-c", PLANS)


@pytest.mark.slow
def test_plans_run_with_its_provider_and_any_agent_as_another_skill(tmp_path):
    command = "run --agent hab_tp_srl:tp_srl --env my_kitchen:ClearCabinet-v1 --episodes 1 --seed 3"
    options = "--option skills=spa_priv --option pick=hab_eval:straight_line"
    run("-m", "hab_eval", *command.split(), *options.split(), "--out", str(tmp_path / "run"))
    (row,) = json.loads((tmp_path / "run/run.json").read_text())["episodes"]
    assert row["stages"] == {"open_cabinet": True, "pick_can": True, "place_can": False}
    trace = json.loads((tmp_path / "run/traces.jsonl").read_text())["trace"]
    did = {entry["did"]: (entry["by"], entry["achieved"]) for entry in trace if "by" in entry}
    assert did["open_cabinet"] == ("spa_priv", True)
    assert did["pick"] == ("Straight line", True)
