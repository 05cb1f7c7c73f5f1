"""Tasks that HAB lacks: their declarations, episodes and plans."""

import gymnasium as gym
import pytest
from hab_eval.cli import main
from hab_eval.records.results import read_record
from hab_plans.plan import plan_of
from hab_plans.problem import problem_of
from hab_plans.solve import replay

from hab_tasks.receptacles import SOFA

HOUSEHOLD = "hab_tasks.tasks.household"


@pytest.mark.parametrize("task", ["HabClearAll-v1", "HabServeDrink-v1"])
def test_plans_reach_the_goal_and_leave_the_fridge_closed(task):
    problem, plan = problem_of(f"{HOUSEHOLD}:{task}"), plan_of(f"{HOUSEHOLD}:{task}")
    assert replay(problem, plan)[-1] >= problem.goal
    skills = [action.skill for action in plan.interactions]
    assert skills.count("pick") == skills.count("place") == len(problem.things["item"])
    assert skills[-1] == "close_fridge"


def test_everything_on_the_sofa_is_a_target():
    env = gym.make(f"{HOUSEHOLD}:HabClearAll-v1", obs_mode="state_dict", num_episodes=2)
    _, info = env.reset(seed=0)
    (episode,) = env.unwrapped.episode
    assert len(info["instruction"][0].split("the sofa")) == 5  # told once for each target
    assert {target.start[0] for target in episode.targets} == {SOFA}
    heights = {name: pose[2] for name, pose in episode.objects.items()}
    targets = {target.object for target in episode.targets}
    middle = [sum(episode.objects[n][k] for n in targets) / 4 for k in (0, 1)]
    # The sofa is 2 m long; nothing else lies within 0.5 m of the targets' middle, at their height.
    for name in episode.objects.keys() - targets:
        gaps = [abs(episode.objects[name][k] - middle[k]) for k in (0, 1)]
        level = min(abs(heights[name] - heights[n]) for n in targets) < 0.1
        assert max(gaps) > 0.5 or not level
    env.close()


@pytest.mark.long
def test_a_planner_serves_a_drink(tmp_path):
    agent = ["--agent", "hab_spa:tp_spa_priv", "--option", "planner=batched"]
    env = ["--env", f"{HOUSEHOLD}:HabServeDrink-v1", "--split", "test", "--episodes", "1"]
    assert main(["run", *agent, *env, "--out", str(tmp_path / "run")]) == 0
    (episode,) = read_record(tmp_path / "run" / "run.json").episodes
    assert episode.success, episode
    assert list(episode.stages) == [
        *("pick_mug", "place_mug", "open_fridge", "pick_drink", "place_drink", "close_fridge")
    ]
