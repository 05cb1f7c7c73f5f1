"""All skills and tasks are feasible: a privileged robot solves them from start to end."""

import gymnasium as gym
import pytest
import torch
from builders import starts_on
from hab_eval.config import EvalConfig
from hab_eval.environments import make_env
from hab_eval.load_agent import load_agent
from hab_eval.runner import run_episode
from hab_spa.agents.factories import SKILLS

from hab_tasks.agent import AgentSetup
from hab_tasks.envs import ENVS
from hab_tasks.episodes import EpisodeRequest, open_source

SEED = 11
FEW, MANY = (3, 2), (10, 9)
"""Episodes, and how many have to be solved; in CI few."""

TASKS = {"HabTidyHouse-v1": 0, "HabPrepareGroceries-v1": 1, "HabSetTable-v1": 0}
"""One of the apartment's evaluation episodes each."""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A cache that is empty at first, so that nothing made by an older version is played."""
    return tmp_path_factory.mktemp("cache")


APARTMENT, REAL = "apartment", "real"
slow, long, assets = pytest.mark.slow, pytest.mark.long, pytest.mark.assets

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
def dataset_of(request, monkeypatch, cache):
    """Name -> options of where to play."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(cache))

    def options(name):
        if name == APARTMENT:
            return {"scene_dataset": "apartment", "split": "val"}
        data = request.getfixturevalue("data")
        real = {"scene_dataset": str(data / "replica_cad"), "objects": str(data / "ycb")}
        return {**real, "split": "train"}

    return options


def played(agent, env_id, dataset, episodes):
    """Plays episodes; returns how each went."""
    torch.set_num_threads(1)
    config = EvalConfig(agent=agent, env=env_id, seed=SEED, **dataset)
    actor = load_agent(agent, AgentSetup(env_id=env_id, seed=SEED))
    env = make_env(config, actor.spec, split=dataset["split"], render=False)
    results = [run_episode(env, actor, 0, episode).episode for episode in episodes]
    env.close()
    return results


def test_every_skill_is_played():
    assert set(SKILLS) == {id_ for id_, entry in ENVS.items() if not hasattr(entry.env, "task")}
    assert set(TASKS) == set(ENVS) - set(SKILLS)


@pytest.mark.parametrize(("env_id", "where", "count", "needed"), PLAYED)
def test_nearly_all_starts_of_a_skill_are_solved(env_id, where, count, needed, dataset_of):
    dataset = dataset_of(where)
    source = open_source(EpisodeRequest(env_id=env_id, seed=SEED, **dataset))
    episodes = [source.get(index) for index in range(count)]
    results = played("hab_spa:spa_priv", env_id, dataset, episodes)
    assert sum(result.success for result in results) >= needed, results


@pytest.mark.parametrize(
    ("where", "count", "failed"),
    [
        pytest.param(APARTMENT, 2, 1, marks=slow),
        pytest.param(APARTMENT, 10, 2, marks=long),
        pytest.param(REAL, 10, 2, marks=(long, assets)),
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
def test_an_expert_solves_its_skill(env_id, control_mode, method, where, count, failed, dataset_of):
    env = gym.make(f"hab_tasks:{env_id}", control_mode=control_mode, **dataset_of(where))
    ended = []
    for number in range(count):
        env.reset(options={"episode": number, "reconfigure": True})
        over = False
        while not over:
            action = torch.from_numpy(getattr(env.unwrapped, method)())
            _, _, terminated, truncated, info = env.step(action)
            over = bool(terminated) or bool(truncated)
        ended.append(bool(info["success"]))
    env.close()
    # A base pose is always reached.
    assert sum(ended) >= count - (failed if env_id != "HabNavigate-v1" else 0)


@pytest.mark.parametrize(
    ("where", "count", "needed"),
    [
        pytest.param(APARTMENT, *FEW, marks=slow),
        pytest.param(APARTMENT, *MANY, marks=long),
        pytest.param(REAL, *MANY, marks=(long, assets)),
    ],
)
def test_objects_in_the_fridge_are_picked(where, count, needed, dataset_of):
    dataset = dataset_of(where)
    source, found, index = open_source(EpisodeRequest(env_id="HabPick-v1", **dataset)), [], 0
    while len(found) < count:
        if starts_on(source.get(index), "refrigerator"):
            found.append(source.get(index))
        index += 1
    results = played("hab_spa:spa_priv", "HabPick-v1", dataset, found)
    assert sum(result.success for result in results) >= needed, results


@pytest.mark.long
@pytest.mark.parametrize("env_id", TASKS)
def test_a_task_is_done_stage_by_stage(env_id):
    dataset = {"scene_dataset": "apartment", "split": "val"}
    episode = open_source(EpisodeRequest(env_id=env_id, **dataset)).get(TASKS[env_id])
    (result,) = played("hab_spa:tp_spa_priv", env_id, dataset, [episode])
    assert list(result.stages) == list(ENVS[env_id].env.task.stages)
    assert all(result.stages.values()), result
    assert result.success
