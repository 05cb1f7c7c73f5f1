"""Start states are neither solved nor failed: no-op and random actions rarely succeed."""

import gymnasium as gym
import hab_eval
import pytest
import torch
from playing import long, slow

from hab_tasks.agent import AgentSetup
from hab_tasks.envs import ENVS

EARLY_STEPS = 25
"""Nobody who stands still may lose within these."""

STANDING = ("do_nothing", "close_hand", "open_hand")
SHARE_AT_RANDOM = {"HabPick-v1": 0.05, "HabPlace-v1": 0.05}
"""Share of episodes that random actions may win; `SHARE_ELSEWHERE` where none is given."""

SHARE_ELSEWHERE = 0.01

STEPS = 200
TASK_STEPS = 100
"""Steps of random actions in a task; they do not reach its first stage."""

RESTING_STEPS = 40
"""So many are played of who stands still: nothing changes later, unless something was let go."""


def played(env_id, name, count, steps, **options):
    """What an agent that knows nothing earns in each episode, in so many steps at most.

    Returns:
        The numbers of episodes that were won, lost early, and that reached a stage of a task.
    """
    agent = getattr(hab_eval, name)(AgentSetup(env_id=env_id))
    mode = agent.spec.control_mode
    env = gym.make(env_id, obs_mode="state_dict", control_mode=mode, **options)
    won, lost_early, advanced = [], [], []
    for index in range(count):
        obs, info = env.reset(options={"episode": index})
        agent.reset(torch.ones(1, dtype=torch.bool), [index])
        for step in range(steps):
            obs, _, terminated, _, info = env.step(agent.act(obs))
            if terminated:
                won += [index] * bool(info["success"][0])
                lost_early += [index] * (not info["success"][0] and step < EARLY_STEPS)
                break
        else:
            advanced += [index] * any(info.get("stages", {}).values())
    env.close()
    return won, lost_early, advanced


def check_standing_still_earns_nothing(env_id, count, **options):
    for name in STANDING:
        steps = STEPS if (env_id, name) == ("HabPlace-v1", "open_hand") else RESTING_STEPS
        assert played(env_id, name, count, steps, **options) == ([], [], []), name


@pytest.mark.parametrize("count", [pytest.param(3, marks=slow), pytest.param(50, marks=long)])
@pytest.mark.parametrize("env_id", ENVS)
def test_standing_still_earns_nothing(env_id, count):
    check_standing_still_earns_nothing(env_id, count)


@pytest.mark.parametrize(
    ("env_id", "count"),
    [
        *(pytest.param(e, 3, marks=slow) for e in ("HabPick-v1", "HabPlace-v1", "HabTidyHouse-v1")),
        *(pytest.param(e, 50 if hasattr(ENVS[e].env, "task") else 100, marks=long) for e in ENVS),
    ],
)
def test_random_actions_earn_next_to_nothing(env_id, count):
    steps = TASK_STEPS if hasattr(ENVS[env_id].env, "task") else STEPS
    won, _, _ = played(env_id, "random_agent", count, steps, num_episodes=count)
    assert len(won) <= SHARE_AT_RANDOM.get(env_id, SHARE_ELSEWHERE) * count, won


@long
@pytest.mark.assets
@pytest.mark.parametrize("env_id", ENVS)
def test_standing_still_earns_nothing_in_replica_cad(env_id, generated, data, tmp_path):
    source, episodes = generated(env_id, "real")
    file = source.save(len(episodes), tmp_path / "episodes.json")
    real = {"scene_dataset": data / "replica_cad", "objects": data / "ycb", "episodes": file}
    check_standing_still_earns_nothing(env_id, len(episodes), **real)
