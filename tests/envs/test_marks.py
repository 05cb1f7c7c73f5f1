"""Marks of the episode's targets appear in human-render images only."""

import gymnasium as gym
import numpy as np
import pytest
import torch

from hab_tasks.engine.marks import GOAL_COLOR, HANDLE_COLOR, TARGET_COLOR, marked_points

COLORS = {
    "HabPick-v1": [TARGET_COLOR],
    "HabPlace-v1": [TARGET_COLOR, GOAL_COLOR],
    "HabOpenDrawer-v1": [TARGET_COLOR, HANDLE_COLOR],
}


@pytest.mark.parametrize("env_id", COLORS)
def test_target_goal_and_handle_are_marked_where_they_are(env_id):
    env = gym.make(f"hab_tasks:{env_id}", obs_mode="state")
    env.reset(seed=0)
    base = env.unwrapped
    points = list(marked_points(base._simulation))
    assert [color for color, _ in points] == COLORS[env_id]
    snapshot, goals = base._simulation.snapshot, base._simulation.goals
    where = {
        TARGET_COLOR: snapshot.objects_m[0][0],
        GOAL_COLOR: goals.goals_m[0][0],
        HANDLE_COLOR: snapshot.handles_m[0][0] if len(snapshot.handles_m[0]) else None,
    }
    for color, point_m in points:
        np.testing.assert_allclose(point_m, where[color], atol=1e-6)
    env.close()


@pytest.mark.render
def test_marks_are_in_a_persons_picture_and_not_in_the_agents():
    """Place: an arrow of each colour. The agent's picture is that of an environment without."""
    pictures = {}
    for render_mode in (None, "rgb_array"):
        env = gym.make("hab_tasks:HabPlace-v1", obs_mode="rgb", render_mode=render_mode)
        env.reset(seed=0)
        base = env.unwrapped
        if render_mode:
            human = base.render_rgb_array()[0].numpy().astype(int)
            states = base.get_state_dict()["actors"]
            assert not [name for name in states if "mark" in name]
        obs, *_ = env.step(torch.zeros(env.action_space.shape))
        pictures[render_mode] = obs["sensor_data"]["head"]["rgb"]
        if render_mode:
            again = base.look()["sensor_data"]["head"]["rgb"]
            assert torch.equal(again, pictures[render_mode])
            base._marks = None
            base._hidden_objects.clear()
            unmarked = base.render_rgb_array()[0].numpy().astype(int)
        env.close()
    assert (human - unmarked).any()
    red, green, blue = human[..., 0], human[..., 1], human[..., 2]
    orange = (red > 180) & (green < 160) & (blue < 80)
    bright_green = (green > 150) & (red < 90) & (blue < 120)
    assert orange.sum() + bright_green.sum() > 30
    # Lamps are only there for colour or for a person, so both have them.
    torch.testing.assert_close(pictures[None], pictures["rgb_array"])
