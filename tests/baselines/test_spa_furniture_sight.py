"""Fridge and drawer as SPA sees them: where the handle is, closed and open."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from hab_spa.scenes.seen_furniture import SeenDrawer, SeenFridge

from hab_tasks.robots.fetch import FETCH

SEEDS = range(500, 504)


@pytest.mark.parametrize("dataset", ["apartment", "real"])
@pytest.mark.parametrize(
    # A robot that faces an open door's handle need not see the fridge; it turns to it then. Where
    # a drawer's handle is along the front, the hand finds out.
    ("env_id", "opened", "least", "near_m", "else_m"),
    [
        ("HabOpenFridge-v1", False, 4, 0.05, 0.05),
        ("HabCloseFridge-v1", True, 2, 0.05, np.inf),
        ("HabOpenDrawer-v1", False, 4, 0.1, 0.4),
        ("HabCloseDrawer-v1", True, 4, 0.1, 0.4),
    ],
)
def test_furniture_is_found_in_depth(request, dataset, env_id, opened, least, near_m, else_m):
    scenes = {"scene_dataset": "apartment"}
    if dataset == "real":
        names = {"scene_dataset": "replica_cad", "objects": "ycb"}
        scenes = {key: str(request.getfixturevalue(name)) for key, name in names.items()}
    env = gym.make(f"hab_tasks:{env_id}", obs_mode="depth", **scenes)
    off_m = []
    for seed in SEEDS:
        obs, _ = env.reset(seed=seed)
        scene = SeenFridge(FETCH) if "Fridge" in env_id else SeenDrawer(FETCH)
        scene.see(obs, 0)
        if scene.find(opened):
            (true,) = env.unwrapped.privileged()[0].articulations
            off_m.append(np.linalg.norm(scene.articulation(0).handle_m - true.handle_m))
    env.close()
    assert len(off_m) >= least
    assert sum(gap_m < near_m for gap_m in off_m) >= len(off_m) - opened
    assert max(off_m) < else_m
