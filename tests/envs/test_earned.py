"""Start states are neither solved nor failed: no-op and random actions rarely succeed."""

from dataclasses import dataclass

import gymnasium as gym
import hab_eval
import pytest
import torch

from hab_tasks.agent import AgentSetup
from hab_tasks.envs import ENVS

pytestmark = pytest.mark.slow

COUNT = 50
EARLY_STEPS = 25
"""Nobody who stands still may lose within these."""

STANDING = ("do_nothing", "close_hand", "open_hand")
SHARE_AT_RANDOM = {"HabPick-v1": 0.05, "HabPlace-v1": 0.05}
"""Share of episodes that random actions may win; `SHARE_ELSEWHERE` where none is given."""

SHARE_ELSEWHERE = 0.01

STEPS = 200
RANDOM_SKILL = (100, STEPS)
RANDOM_TASK = (50, 100)
"""Episodes and steps of random actions; a task's first stage is not reached by them."""

RESTING_STEPS = 40
"""So many are played of who stands still: nothing changes later, unless something was let go."""


@dataclass(frozen=True)
class Outcome:
    """How an episode went."""

    won: bool = False
    lost_early: bool = False
    stages: int = 0


def play(env, agent, index, steps):
    """Plays one episode for so many steps at most."""
    obs, info = env.reset(options={"episode": index})
    agent.reset(torch.ones(1, dtype=torch.bool), [index])
    for step in range(steps):
        obs, _, terminated, _, info = env.step(agent.act(obs))
        if terminated:
            won = bool(info["success"][0])
            return Outcome(won=won, lost_early=not won and step < EARLY_STEPS)
    return Outcome(stages=sum(bool(reached) for reached in info.get("stages", {}).values()))


def outcomes(env_id, name, count, steps, **options):
    """Plays the first episodes of a set with one of the agents that know nothing."""
    agent = getattr(hab_eval, name)(AgentSetup(env_id=env_id))
    env = gym.make(env_id, obs_mode="state_dict", control_mode=agent.spec.control_mode, **options)
    found = [play(env, agent, index, steps) for index in range(count)]
    env.close()
    return found


def check_nothing_is_earned(found):
    """Shows the numbers of those that are."""
    assert not [index for index, outcome in enumerate(found) if outcome.won]
    assert not [index for index, outcome in enumerate(found) if outcome.lost_early]
    assert not [index for index, outcome in enumerate(found) if outcome.stages]


def horizon(env_id, name):
    return STEPS if (env_id, name) == ("HabPlace-v1", "open_hand") else RESTING_STEPS


@pytest.mark.parametrize("name", STANDING)
@pytest.mark.parametrize("env_id", ENVS)
def test_standing_still_earns_nothing(env_id, name):
    check_nothing_is_earned(outcomes(env_id, name, COUNT, horizon(env_id, name)))


@pytest.mark.parametrize("env_id", ENVS)
def test_random_actions_earn_next_to_nothing(env_id):
    count, steps = RANDOM_TASK if hasattr(ENVS[env_id].env, "task") else RANDOM_SKILL
    found = outcomes(env_id, "random_agent", count, steps, num_episodes=count)
    won = [index for index, outcome in enumerate(found) if outcome.won]
    assert len(won) <= SHARE_AT_RANDOM.get(env_id, SHARE_ELSEWHERE) * count, won


@pytest.mark.assets
@pytest.mark.parametrize("env_id", ENVS)
def test_standing_still_earns_nothing_in_replica_cad(env_id, generated, data, tmp_path):
    source, episodes = generated(env_id, "real")
    file = source.save(len(episodes), tmp_path / "episodes.json")
    real = {"scene_dataset": data / "replica_cad", "objects": data / "ycb", "episodes": file}
    for name in STANDING:
        found = outcomes(env_id, name, len(episodes), horizon(env_id, name), **real)
        check_nothing_is_earned(found)
