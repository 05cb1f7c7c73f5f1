"""Marks of the episode's targets appear in human-render images only."""

import numpy as np
import pytest
import torch
from playing import still

from hab_tasks.engine.viewpoint import marked_points


@pytest.mark.render
@pytest.mark.new_env
def test_marks_are_in_a_persons_picture_and_not_in_the_agents(make):
    """Place: an arrow of each colour. The agent's picture is that of an environment without."""
    shown, plain = (make("HabPlace-v1", obs_mode="rgb", render_mode=m) for m in ("rgb_array", None))
    for env in (shown, plain):
        env.reset(seed=0)
    base = shown.unwrapped
    world = base.simulation
    target, goal = marked_points(world)
    np.testing.assert_allclose(target[1], world.snapshot.objects_m[0][0], atol=1e-6)
    np.testing.assert_allclose(goal[1], world.goals.goals_m[0][0], atol=1e-6)
    human = base.render_rgb_array()[0].numpy().astype(int)
    assert not [name for name in base.get_state_dict()["actors"] if "mark" in name]
    seen, expected = (e.step(still(e))[0]["sensor_data"]["head"]["rgb"] for e in (shown, plain))
    assert torch.equal(base.look()["sensor_data"]["head"]["rgb"], seen)
    base._marks = None
    base._hidden_objects.clear()
    assert (human - base.render_rgb_array()[0].numpy().astype(int)).any()
    red, green, blue = human[..., 0], human[..., 1], human[..., 2]
    orange = (red > 180) & (green < 160) & (blue < 80)
    bright_green = (green > 150) & (red < 90) & (blue < 120)
    assert orange.sum() + bright_green.sum() > 30
    # Lamps are only there for colour or for a person, so both have them.
    torch.testing.assert_close(expected, seen)
