"""Maps of navigating robots, against values worked out by hand and the true map."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hab_ppo.errors import RecipeError
from hab_ppo.examples import Examples
from hab_ppo.map_memory import CHANNELS, SEEN, SIDE_PX, STOPPED, VISITED, MapMemory
from hab_ppo.mapped_rows import RowMaps
from hab_ppo.mirror import mirrored
from hab_ppo.observation import Observation
from hab_ppo.recipes import find_recipe
from hab_ppo.warm_start import make_rows

from hab_tasks.robots.control_modes import BASE_CELLS, STOP_CELL

RECIPE = find_recipe("navigate_mapped")
NOTHING = np.zeros((1, 128, 128, 1), dtype=np.float32)
MIDDLE = SIDE_PX // 2
TURN_RAD = 4 * 3.14 / 30
"""Turn of four steps at full speed."""


def point(x, y):
    return np.array([[x, y, 0.8]], dtype=np.float32)


def turned(x, y, yaw):
    """A point of the first frame in that of a base at the origin which has turned."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return point(cosine * x + sine * y, cosine * y - sine * x)


def wall_ahead(distance_m):
    """The depth image of a wall; the camera is at x = 0.17 and looks down by 0.2 in 0.58."""
    slopes = 2 * (np.arange(128) + 0.5) / 128 - 1
    down_rad = np.arctan2(0.2, 0.58)
    # A ray goes 1 forwards and s down in the camera; tilted, cos - s sin forwards in the base.
    forward = np.cos(down_rad) - slopes * np.sin(down_rad)
    depth_m = (distance_m - 0.17) / forward
    image = np.repeat(depth_m[:, None], 128, axis=1) / 10.0
    return image[None, :, :, None].astype(np.float32)


def test_the_pose_follows_from_the_turns_and_the_point():
    maps = MapMemory(1, 4)
    maps.look(NOTHING, point(2.0, 1.0))
    assert maps.pose.tolist() == [[0.0, 0.0, 0.0]]
    maps.turn(np.array([BASE_CELLS.index((0.0, 1.0))]))
    maps.look(NOTHING, turned(2.0, 1.0, TURN_RAD))
    assert maps.pose[0] == pytest.approx([0.0, 0.0, TURN_RAD], abs=1e-6)
    maps.turn(np.array([BASE_CELLS.index((1.0, 0.0))]))
    ahead = 0.13 * np.array([np.cos(TURN_RAD), np.sin(TURN_RAD)])
    maps.look(NOTHING, turned(2.0 - ahead[0], 1.0 - ahead[1], TURN_RAD))
    assert maps.pose[0] == pytest.approx([*ahead, TURN_RAD], abs=1e-6)


def test_a_blocked_base_does_not_turn():
    maps = MapMemory(2, 4)
    points = np.concatenate((point(2.0, 0.0), point(2.0, 0.0)))
    depth = np.concatenate((NOTHING, NOTHING))
    maps.look(depth, points)
    maps.turn(np.array([BASE_CELLS.index((1.0, 1.0)), STOP_CELL]))
    maps.look(depth, points)
    assert maps.pose == pytest.approx(np.zeros((2, 3)), abs=1e-6)


def test_a_wall_is_drawn_where_it_is():
    maps = MapMemory(1, 4)
    (image,) = maps.look(wall_ahead(1.25), point(1.25, 0.5))
    assert image.shape == (SIDE_PX, SIDE_PX, CHANNELS)
    heights, seen, mark = image[..., 0], image[..., 1], image[..., 2]
    # The base is between the pixels 31 and 32. A cell is 0.1 m: 1.25 m ahead is the thirteenth up.
    assert set(np.flatnonzero(heights.any(axis=1))) == {MIDDLE - 13}
    # At the floor, 1.2 m down and 1.08 m ahead of the camera, depth is 1.08 m / 0.764 = 1.41 m, and
    # the image is as wide to both sides: 14 cells.
    assert 26 <= np.count_nonzero(heights[MIDDLE - 13]) <= 28
    # The image reaches above 1.8 m, where drawing ends.
    assert heights.max() >= 255 * 1.7 / 1.8
    assert (seen[heights > 0] == SEEN).all()
    assert seen[MIDDLE - 1, MIDDLE - 1] == VISITED
    # 0.5 m to the left: columns 26 and 27 left of the middle, in the same row as the wall.
    assert np.unravel_index(mark.argmax(), mark.shape) == (MIDDLE - 13, MIDDLE - 6)
    coarse = image[..., 3]
    assert set(np.flatnonzero(coarse.any(axis=1))) == {MIDDLE - 6}  # of cells of 0.25 m


def test_the_map_turns_with_the_base_and_remembers():
    maps = MapMemory(1, 4)
    maps.look(wall_ahead(1.25), point(2.0, 0.0))
    for quarter in range(1, 5):  # a quarter turn left in four parts, with nothing in view
        maps.turn(np.array([BASE_CELLS.index((0.0, 1.0))]))
        (image,) = maps.look(NOTHING, turned(2.0, 0.0, quarter * TURN_RAD))
    columns = np.flatnonzero(image[..., 0].any(axis=0))
    # Four turns make 96 degrees: the wall is to the right, tilted by 6.
    assert columns.min() >= MIDDLE + 10
    assert columns.max() <= MIDDLE + 14
    maps.forget(np.array([True]))
    (image,) = maps.look(NOTHING, point(1.0, 0.0))
    assert not image[..., 0].any()
    assert maps.pose.tolist() == [[0.0, 0.0, 0.0]]


def test_rows_that_decide_at_different_times_keep_their_maps():
    maps, both = RowMaps(4), np.concatenate((wall_ahead(1.25), wall_ahead(1.25)))
    obs = {"sensor_data": {"head": {"depth": both}}}
    first = maps.look([0], obs, point(2, 0))
    assert first.any()
    maps.turn([0], np.array([[STOP_CELL]]))
    assert np.array_equal(maps.look([1], obs, point(2, 0)), first)
    # The first row remembers its stop, until it is told to forget.
    assert not np.array_equal(maps.look([0], obs, point(2, 0)), first)
    maps.forget([0])
    assert np.array_equal(maps.look([0], obs, point(2, 0)), first)


def test_mirrored_examples_are_those_of_a_mirrored_room():
    left, right = wall_ahead(1.25), wall_ahead(1.25)
    left[..., :40, :], right[..., -40:, :] = 0.9, 0.9  # nearer than this on one side only
    seen = []
    for depth, y in ((left, 1.0), (right, -1.0)):
        image = MapMemory(1, 4).look(depth, point(2.0, y))
        state = torch.tensor([[0.0, 2.0, y, 0.8]])
        seen.append(Observation(state, torch.from_numpy(image).permute(0, 3, 1, 2)))
    ahead_left, ahead_right = BASE_CELLS.index((1.0, 0.5)), BASE_CELLS.index((1.0, -0.5))
    examples = Examples.of(seen, np.array([ahead_left, ahead_right]))
    found = mirrored(examples, torch.tensor([True, False]))
    assert torch.equal(found.state[0], examples.state[1])
    # Pixels are between rays, and points on the borders of cells: a few cells differ.
    differs = (found.images[0] != examples.images[1]).float().mean()
    assert differs < 0.02 < (examples.images[0] != examples.images[1]).float().mean()
    assert found.actions.tolist() == [ahead_right, ahead_right]


@pytest.mark.parametrize("changes", [{"control_mode": "base"}, {"obs_mode": "rgb"}])
def test_a_recipe_whose_env_has_no_map_is_rejected(changes):
    with pytest.raises(RecipeError, match="navigate_mapped has map_memory, which needs"):
        replace(RECIPE, env=replace(RECIPE.env, **changes))


def base_of(obs):
    """The base's x, y [m] and yaw in the world; the camera is 0.17 m ahead of it."""
    camera = obs["sensor_param"]["head"]["cam2world_gl"][0]
    yaw = np.arctan2(-camera[1, 2], -camera[0, 2])
    return np.array([camera[0, 3] - 0.17 * np.cos(yaw), camera[1, 3] - 0.17 * np.sin(yaw), yaw])


def test_stops_are_marked_until_the_map_is_forgotten():
    maps = MapMemory(2, 4)
    points, depth = np.repeat(point(2.0, 0.0), 2, axis=0), np.repeat(NOTHING, 2, axis=0)
    stop, ahead = STOP_CELL, BASE_CELLS.index((1.0, 0.0))
    maps.look(depth, points)
    maps.turn(np.array([stop, ahead]))
    shown = maps.look(depth, points)[..., 1]
    # The cell of the base and its four neighbours; the second base did not stop.
    assert (shown[0] == STOPPED).sum() == 5
    assert (shown[1] == STOPPED).sum() == 0
    assert (shown[1] == VISITED).sum() == 1
    maps.turn(np.array([ahead, ahead]))
    moved = np.repeat(point(1.5, 0.0), 2, axis=0)
    shown = maps.look(depth, moved)[..., 1]
    # The mark stays, and is now 0.5 m behind, where no visit replaces it.
    assert (shown[0] == STOPPED).sum() == 5
    assert (shown[0] == VISITED).sum() == 1
    maps.forget(np.array([True, False]))
    assert (maps.look(depth, points)[0, ..., 1] == STOPPED).sum() == 0


@pytest.mark.slow
def test_the_pose_in_an_episode_is_the_true_one(tmp_path, monkeypatch):
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path))
    rows = make_rows(replace(RECIPE, env=replace(RECIPE.env, num_episodes=2)), 1, 1)
    try:
        obs, _ = rows.reset(seed=3, options={"reconfigure": True})
        x, y, yaw = base_of(obs)
        for _ in range(20):
            (action,) = rows.call("shortest_path_action", repeat=4)
            obs, *_ = rows.step(action)
    finally:
        rows.close()
    expected = base_of(obs) - (x, y, yaw)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    assert rows._maps.pose[0, 0] == pytest.approx(
        cosine * expected[0] + sine * expected[1], abs=0.05
    )
    assert rows._maps.pose[0, 1] == pytest.approx(
        cosine * expected[1] - sine * expected[0], abs=0.05
    )
    assert np.cos(rows._maps.pose[0, 2] - expected[2]) > np.cos(0.05)
    assert np.linalg.norm(expected[:2]) > 0.5
