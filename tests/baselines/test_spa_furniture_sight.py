"""What SPA sees: a fridge's and a drawer's handle, a fridge's shelves, and what the hand holds."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from hab_spa.scenes.seen_furniture import SeenDrawer, SeenFridge
from hab_spa.scenes.seen_shelves import SeenShelves
from hab_spa.sensing.known_fridge import BODY_NAME
from hab_spa.sensing.walls import supposed_walls
from hab_spa.shapes import invert_pose

from hab_tasks.robots.fetch import FETCH

SEEDS = range(500, 504)
HELD_SEEDS = range(500, 512)


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
            seen = scene.articulation(0)
            off_m.append(np.linalg.norm(seen.handle_m - true.handle_m))
            if "Drawer" in env_id:
                assert abs(seen.joint - true.joint) < 0.04
    env.close()
    assert len(off_m) >= least
    assert sum(gap_m < near_m for gap_m in off_m) >= len(off_m) - opened
    assert max(off_m) < else_m


@pytest.mark.parametrize("dataset", ["apartment", "real"])
def test_the_box_of_a_held_object_and_the_shelves_are_those_seen(request, dataset):
    scenes = {"scene_dataset": "apartment"}
    if dataset == "real":
        names = {"scene_dataset": "replica_cad", "objects": "ycb"}
        scenes = {key: str(request.getfixturevalue(name)) for key, name in names.items()}
    env = gym.make("hab_tasks:HabPlace-v1", obs_mode="depth", **scenes)
    volumes, fridges = [], 0
    for seed in HELD_SEEDS:
        obs, _ = env.reset(seed=seed)
        (true,) = env.unwrapped.privileged()
        scene = SeenShelves(FETCH)
        scene.see(obs, 0)
        scene.look_into(scene.goal_m(0))
        scene.look()
        state = scene._believed()
        corners_m = _held_vertices_m(true)
        seen = next(body for body in state.bodies if body.name == state.held)
        half_m = seen.shapes[0].half_size_m
        box_from_world = invert_pose(state.world_from_body[seen.name])
        local_m = corners_m @ box_from_world[:3, :3].T + box_from_world[:3, 3]
        assert (np.abs(local_m) - half_m).max() < 0.03
        volumes.append(np.prod(2 * half_m) / _least_volume_m3(corners_m))
        shelves = [body for body in state.bodies if body.name == BODY_NAME]
        fridges += len(shelves)
        if shelves:
            told = true.world_from_body["fridge_:0000/body"][:2, 3]
            middle_m = state.world_from_body[BODY_NAME] @ (-0.322, 0.353, 0.0, 1.0)
            assert np.linalg.norm(middle_m[:2] - told) < 0.05
    env.close()
    assert np.median(volumes) < 1.15
    assert fridges or dataset == "real"  # of whose goals few are in a fridge


def _held_vertices_m(state):
    """Vertices (K, 3) of the held object, in the world."""
    body = next(body for body in state.bodies if body.name == state.held)
    found = []
    for shape in body.shapes:
        pose = state.world_from_body[body.name] @ shape.body_from_shape
        found.append(shape.vertices_m @ pose[:3, :3].T + pose[:3, 3])
    return np.concatenate(found)


def _least_volume_m3(points_m):
    """Volume of the smallest upright box around points (K, 3)."""
    yaws = np.linspace(0.0, np.pi / 2, 60)
    turns = [np.array(((np.cos(a), -np.sin(a)), (np.sin(a), np.cos(a)))) for a in yaws]
    area_m2 = min(np.prod(np.ptp(points_m[:, :2] @ turn, axis=0)) for turn in turns)
    return area_m2 * np.ptp(points_m[:, 2])


def test_a_wall_beside_the_fridge_is_supposed_to_go_on():
    out_m, high_m = (one.ravel() for one in np.mgrid[0.1:0.61:0.02, 0.3:1.4:0.02])
    wall_m = np.column_stack((out_m, np.full_like(out_m, 0.6), high_m))
    counter_m = wall_m * (1.0, -1.0, 0.5)  # on the other side, too low for a wall
    # The front faces +y; what is out of it in x there is along -x, so the wall is at x = 2 - 0.6.
    quarter = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    seen_m = np.concatenate((wall_m, counter_m)) @ quarter.T + (2.0, 3.0, 0.0)
    supposed_m = supposed_walls(seen_m, np.array((2.0, 3.0, np.pi / 2, 0.0)), 0.02)
    np.testing.assert_allclose(supposed_m[:, 0], 1.4, atol=1e-9)
    # It has been seen up to y = 3.6, nearly, and is supposed for 1.2 m more.
    assert supposed_m[:, 1].min() == pytest.approx(3.58, abs=0.03)
    assert supposed_m[:, 1].max() == pytest.approx(4.77, abs=0.03)
