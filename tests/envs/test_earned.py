"""Start states are neither solved nor failed: no-op and random actions rarely succeed."""

from contextlib import contextmanager
from dataclasses import dataclass

import gymnasium as gym
import hab_eval
import pytest
import torch

from hab_tasks.agent import AgentSetup
from hab_tasks.envs import ENVS

slow, long = pytest.mark.slow, pytest.mark.long

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


@contextmanager
def made(env_id, names, **options):
    """Makes an environment for agents that know nothing; yields it and the agents by name."""
    agents = {name: getattr(hab_eval, name)(AgentSetup(env_id=env_id)) for name in names}
    (mode,) = {agent.spec.control_mode for agent in agents.values()}
    env = gym.make(env_id, obs_mode="state_dict", control_mode=mode, **options)
    try:
        yield env, agents
    finally:
        env.close()


def check_standing_still_earns_nothing(env_id, count, **options):
    """Shows the agents and the numbers of episodes that earn something."""
    with made(env_id, STANDING, **options) as (env, agents):
        found = {
            (name, index): play(env, agent, index, horizon(env_id, name))
            for name, agent in agents.items()
            for index in range(count)
        }
    assert not [key for key, outcome in found.items() if outcome.won]
    assert not [key for key, outcome in found.items() if outcome.lost_early]
    assert not [key for key, outcome in found.items() if outcome.stages]


def horizon(env_id, name):
    return STEPS if (env_id, name) == ("HabPlace-v1", "open_hand") else RESTING_STEPS


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
    with made(env_id, ["random_agent"], num_episodes=count) as (env, agents):
        (agent,) = agents.values()
        found = [play(env, agent, index, steps) for index in range(count)]
    won = [index for index, outcome in enumerate(found) if outcome.won]
    assert len(won) <= SHARE_AT_RANDOM.get(env_id, SHARE_ELSEWHERE) * count, won


@long
@pytest.mark.assets
@pytest.mark.parametrize("env_id", ENVS)
def test_standing_still_earns_nothing_in_replica_cad(env_id, generated, data, tmp_path):
    source, episodes = generated(env_id, "real")
    file = source.save(len(episodes), tmp_path / "episodes.json")
    real = {"scene_dataset": data / "replica_cad", "objects": data / "ycb", "episodes": file}
    check_standing_still_earns_nothing(env_id, len(episodes), **real)
