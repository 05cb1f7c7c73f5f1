"""All skills and tasks are feasible: a privileged robot solves them from start to end."""

import gymnasium as gym
import pytest
import torch
from hab_eval.records.config import EvalConfig
from hab_eval.run.agents import load_agent
from hab_eval.run.environments import make_env
from hab_eval.run.runner import run_episode
from hab_spa.agents.skill_agents import SKILLS
from playing import long, slow

from hab_tasks.agent import AgentSetup
from hab_tasks.envs import ENVS
from hab_tasks.episodes import EpisodeRequest, open_source

SEED = 11
FEW, MANY = (3, 2), (10, 9)
"""Episodes, and how many have to be solved; in CI few."""

TASKS = {"HabTidyHouse-v1": 0, "HabPrepareGroceries-v1": 1, "HabSetTable-v1": 0}
"""One of the apartment's evaluation episodes each."""


APARTMENT, REAL = "apartment", "real"
assets = pytest.mark.assets

PLAYED = [
    pytest.param(env_id, where, *case, marks=marks)
    for number, env_id in enumerate(SKILLS)
    for where, case, marks in (
        ((APARTMENT, FEW, slow), (REAL, MANY, (long, assets)))
        if number % 2 == 0
        else ((REAL, FEW, (slow, assets)), (APARTMENT, MANY, long))
    )
]
"""Every skill in both datasets, in one of them by few episodes."""


@pytest.fixture
def dataset_of(request):
    """Name -> options of where to play."""

    def options(name):
        if name == APARTMENT:
            return {"scene_dataset": "apartment", "split": "val"}
        data = request.getfixturevalue("data")
        real = {"scene_dataset": str(data / "replica_cad"), "objects": str(data / "ycb")}
        return {**real, "split": "train"}

    return options


def played(agent, env_id, dataset, episodes):
    """Plays episodes; returns how each went."""
    config = EvalConfig(agent=agent, env=env_id, seed=SEED, **dataset)
    actor = load_agent(agent, AgentSetup(env_id=env_id, seed=SEED))
    env = make_env(config, actor.spec, split=dataset["split"], render=False)
    results = [run_episode(env, actor, 0, episode).episode for episode in episodes]
    env.close()
    return results


def test_every_skill_is_played():
    assert {*SKILLS, *TASKS} == set(ENVS)


@pytest.mark.parametrize(("env_id", "where", "count", "needed"), PLAYED)
def test_nearly_all_starts_of_a_skill_are_solved(env_id, where, count, needed, dataset_of):
    dataset = dataset_of(where)
    source = open_source(EpisodeRequest(env_id=env_id, seed=SEED, **dataset))
    episodes = [source.get(index) for index in range(count)]
    results = played("hab_spa:spa_priv", env_id, dataset, episodes)
    assert sum(result.success for result in results) >= needed, results


@pytest.mark.parametrize(
    ("where", "count", "needed"),
    [
        pytest.param(APARTMENT, 2, 1, marks=slow),
        pytest.param(APARTMENT, 10, 8, marks=long),
        pytest.param(REAL, 10, 8, marks=(long, assets)),
    ],
)
@pytest.mark.parametrize(
    ("env_id", "control_mode", "method"),
    [
        ("HabNavigate-v1", "base_discrete", "shortest_path_action"),
        ("HabPick-v1", "ee", "pick_action"),
        ("HabPlace-v1", "ee", "place_action"),
        ("HabOpenDrawer-v1", "ee", "drawer_action"),
        ("HabCloseDrawer-v1", "ee", "drawer_action"),
        ("HabOpenFridge-v1", "ee_base", "door_action"),
        ("HabCloseFridge-v1", "ee_base", "door_action"),
    ],
)
def test_an_expert_solves_its_skill(env_id, control_mode, method, where, count, needed, dataset_of):
    """A base pose is always reached."""
    env = gym.make(f"hab_tasks:{env_id}", control_mode=control_mode, **dataset_of(where))
    solved = 0
    for number in range(count):
        env.reset(options={"episode": number, "reconfigure": True})
        over = False
        while not over:
            action = torch.from_numpy(env.unwrapped.ask(f"hab_experts:{method}"))
            _, _, terminated, truncated, info = env.step(action)
            over = bool(terminated) or bool(truncated)
        solved += bool(info["success"])
    env.close()
    assert solved >= (count if env_id == "HabNavigate-v1" else needed)


@long
@pytest.mark.parametrize("env_id", TASKS)
def test_a_task_is_done_stage_by_stage(env_id):
    dataset = {"scene_dataset": "apartment", "split": "val"}
    episode = open_source(EpisodeRequest(env_id=env_id, **dataset)).get(TASKS[env_id])
    (result,) = played("hab_spa:tp_spa_priv", env_id, dataset, [episode])
    assert list(result.stages) == list(ENVS[env_id].env.task.stages)
    assert all(result.stages.values()), result
    assert result.success
