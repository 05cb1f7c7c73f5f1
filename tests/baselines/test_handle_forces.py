"""SPA-Priv opens and closes, and pushes softly while it holds a handle."""

import gymnasium
import numpy as np
import pytest
import torch
from hab_spa.agents.skill_agents import spa_priv

from hab_tasks.agent_spaces import agent_setup

ARTICULATION_KINDS = [
    f"Hab{way}{what}-v1" for way in ("Open", "Close") for what in ("Fridge", "Drawer")
]
MOST_N, SHARE_PERCENT = 1000.0, 99.0
"""In this share of the steps with a handle in the hand, contacts push no harder."""


slow, long = pytest.mark.slow, (pytest.mark.long, pytest.mark.assets)
CASES = [
    *(pytest.param(env_id, "apartment", 2, marks=slow) for env_id in ARTICULATION_KINDS),
    pytest.param("HabOpenDrawer-v1", "real", 2, marks=(slow, pytest.mark.assets)),
    *(pytest.param(env_id, "real", 5, marks=long) for env_id in ARTICULATION_KINDS),
]


@pytest.mark.parametrize(("env_id", "dataset", "episodes"), CASES)
def test_opens_and_closes_softly(env_id, dataset, episodes, request):
    options = {}
    if dataset == "real":
        data = request.getfixturevalue("data")
        options = {"scene_dataset": data / "replica_cad", "objects": data / "ycb"}
    agent = spa_priv(agent_setup(env_id, seed=5))
    env = gymnasium.make(env_id, control_mode=agent.spec.control_mode, episode_seed=5, **options)
    base, forces, won = env.unwrapped, [], 0
    for index in range(episodes):
        _, info = env.reset(options={"episode": index})
        agent.reset(torch.ones(1, dtype=torch.bool), [base.episode[0].seed])
        done = False
        while not done:
            action = agent.act({"privileged": base.privileged()})
            _, _, terminated, truncated, info = env.step(action)
            done = bool(terminated) or bool(truncated)
            if bool(base.measures.holding_handle[0]):
                forces.append(float(base.measures.force_n[0]))
        won += bool(info["success"])
    env.close()
    assert len(forces) >= 10 * episodes
    assert won >= episodes - 1
    assert np.percentile(forces, SHARE_PERCENT) <= MOST_N
