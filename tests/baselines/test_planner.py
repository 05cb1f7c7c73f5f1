"""The task planner: plans are valid, minimal and in task order; infeasible goals raise errors."""

import pytest
from hab_plans import Action, NoPlanError, Plan, PlannerError, plan_of, problem_of
from hab_plans.belief import start_given
from hab_plans.cli import main
from hab_plans.problem import task_of
from hab_plans.solve import replay, solve

from hab_tasks.registration import TASKS

# Navigate before each interaction: 5 objects x 4; 3 objects x 4; 8 interactions x 2.
LENGTHS = {"HabTidyHouse-v1": 20, "HabPrepareGroceries-v1": 12, "HabSetTable-v1": 16}


def test_a_tasks_plan_is_minimal_in_the_order_of_its_parts_and_what_the_planner_finds():
    assert list(TASKS) == list(LENGTHS)
    for env_id, length in LENGTHS.items():
        problem, plan = problem_of(env_id), plan_of(env_id)
        assert len(plan.actions) == length
        assert plan == solve(problem)
        expected = [part.skill.name for part in task_of(env_id).parts]
        assert [action.skill for action in plan.actions] == expected
        # The goal is reached with the last action only.
        told = replay(problem, plan)
        assert [holds == problem.goal for holds in told] == [False] * length + [True]


def test_set_table_places_the_apple_only_in_a_bowl_that_is_there():
    problem = problem_of("HabSetTable-v1")
    # Apple in the hand, fridge open, robot at the table, the bowl still in its drawer.
    start = problem.start - {("hand-empty",), ("at-robot", "spawn"), ("is-closed", "fridge")}
    start |= {("holding", "apple"), ("at-robot", "apple-goal"), ("is-open", "fridge")}
    action = Action(
        name="place-inside", things=("apple", "apple-goal", "bowl", "bowl-goal", "room")
    )
    with pytest.raises(PlannerError, match="Action 1, place-inside"):
        replay(problem.started(start), Plan(task="set-table", actions=(action,)))


def test_an_action_that_does_not_exist_is_refused():
    for name, things in (("fly", ("bowl",)), ("pick", ("cup", "room"))):
        plan = Plan(task="set-table", actions=(Action(name=name, things=things),))
        with pytest.raises(PlannerError, match=r"Action 1, .* does not exist"):
            replay(problem_of("HabSetTable-v1"), plan)


def test_planning_goes_on_from_where_things_are():
    problem = problem_of("HabSetTable-v1")
    bowl = {("at", "bowl", "bowl-goal"), ("placed", "bowl")}
    # Navigate and open, navigate and pick, navigate and place, navigate and close are left.
    assert len(solve(problem.started(problem.start | bowl)).actions) == 8
    # With nothing to fetch, only the way to a drawer that stands ajar and the push are left.
    ajar = problem.start - {("is-closed", "drawer")} | bowl
    done = ajar | {("at", "apple", "apple-goal"), ("placed", "apple")}
    left = solve(problem.started(done)).actions
    assert [str(action) for action in left] == ["navigate(spawn, drawer)", "close(drawer)"]
    # An apple beside the bowl is not fetched from the fridge.
    beside = frozenset({("at", "bowl", "bowl-goal"), ("in", "apple", "room")})
    beside |= {("is-closed", "drawer"), ("is-closed", "fridge")}
    left = solve(problem.started(start_given("HabSetTable-v1", beside))).actions
    assert [action.name for action in left] == ["navigate", "pick", "navigate", "place-inside"]


def test_a_goal_that_cannot_be_reached_is_named():
    problem = problem_of("HabSetTable-v1")
    stuck = problem.start - {("articulated", "fridge")}
    with pytest.raises(NoPlanError, match=r"No plan of set-table .*at apple apple-goal"):
        solve(problem.started(stuck))


def test_a_plan_is_written_and_never_overwritten(tmp_path, capsys):
    file = tmp_path / "plan.json"
    arguments = ["plan", "HabSetTable-v1", "--solve", "--out", str(file)]
    assert main(arguments) == 0
    assert "(:action navigate" in capsys.readouterr().out
    assert file.read_text(encoding="utf-8") == plan_of("HabSetTable-v1").to_json()
    file.write_text("mine", encoding="utf-8")
    assert main(arguments) == 2
    assert "--force" in capsys.readouterr().err
    assert file.read_text(encoding="utf-8") == "mine"
    assert main([*arguments, "--force"]) == 0
    assert file.read_text(encoding="utf-8") != "mine"
