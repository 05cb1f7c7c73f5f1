"""The fridge as SPA sees it: found by its shape, and how far its door is open."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from hab_spa.scenes.seen_fridge import SeenFridge

from hab_tasks.robots.fetch import FETCH

SEEDS = range(500, 506)


@pytest.mark.parametrize("dataset", ["apartment", "real"])
@pytest.mark.parametrize(("env_id", "opened"), [("HabOpenFridge-v1", 0), ("HabCloseFridge-v1", 1)])
def test_the_fridge_is_found_by_its_shape(request, dataset, env_id, opened):
    scenes = {"scene_dataset": "apartment"}
    if dataset == "real":
        names = {"scene_dataset": "replica_cad", "objects": "ycb"}
        scenes = {key: str(request.getfixturevalue(name)) for key, name in names.items()}
    env = gym.make(f"hab_tasks:{env_id}", obs_mode="depth", **scenes)
    off_m = []
    for seed in SEEDS:
        obs, _ = env.reset(seed=seed)
        scene = SeenFridge(FETCH)
        scene.see(obs, 0)
        if scene.find(opened=bool(opened)):
            (true,) = env.unwrapped.privileged()[0].articulations
            off_m.append(np.linalg.norm(scene.articulation(0).handle_m - true.handle_m))
    env.close()
    # A robot that faces an open door's handle need not see the fridge; it turns to it then.
    assert len(off_m) >= (3 if opened else len(SEEDS))
    assert sum(gap_m < 0.05 for gap_m in off_m) >= len(off_m) - opened
