"""Observation entries, checked by hand; options."""

import math
from contextlib import nullcontext

import numpy as np
import pytest
import torch
from builders import goals_of, snapshot

from hab_tasks.engine.sensors import (
    EE_ROTATION,
    HANDLE,
    OBJECT_GOAL,
    OBJECT_START,
    POINT,
    handles_in_base,
    observed,
)
from hab_tasks.envs import ENVS
from hab_tasks.errors import OptionError
from hab_tasks.robots.fetch import FETCH

QUARTER = math.pi / 2

# Two rows. In the first the base looks along the world's x and the hand's frame is the world's; in
# the second the base stands at (1, 2), looks along the world's y, and the hand points down with
# its z ahead of the base: x axis (0, 0, -1), y axis (-1, 0, 0), z axis (0, 1, 0) in the world.
DOWN = [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]
SHOT = snapshot(
    2,
    articulations=1,
    base=torch.tensor([[0.0, 0.0, 0.0], [1.0, 2.0, QUARTER]]),
    ee_m=torch.tensor([[0.5, 0.0, 1.0], [1.0, 2.5, 1.0]]),
    ee_axes=torch.stack([torch.eye(3), torch.tensor(DOWN)]),
    handles_m=torch.tensor([[[0.6, 0.1, 0.9]], [[1.2, 2.9, 0.7]]]),
)
GOALS = goals_of(
    2,
    1,
    1,
    starts_m=torch.tensor([[[0.7, 0.1, 0.8]], [[1.3, 2.9, 0.8]]]),
    goals_m=torch.tensor([[[0.4, -0.2, 1.1]], [[0.9, 2.5, 1.5]]]),
)


BY_HAND = [
    # 0.2 ahead, 0.1 left, 0.2 down; (0.3, 0.4, -0.2) in the world, where the base's x is y and its
    # y is -x: 0.4 ahead and 0.3 to the right.
    (OBJECT_START, [[0.2, 0.1, -0.2], [0.4, -0.3, -0.2]]),
    (OBJECT_GOAL, [[-0.1, -0.2, 0.1], [0.0, 0.1, 0.5]]),
    (HANDLE, [[0.1, 0.1, -0.1], [0.4, -0.2, -0.3]]),
    # (0.3, 0.4, -0.2) along the hand's axes: 0.2 down, -0.3 along -x, 0.4 along y.
    (OBJECT_START.in_ee, [[0.2, 0.1, -0.2], [0.2, -0.3, 0.4]]),
    (OBJECT_GOAL.in_ee, [[-0.1, -0.2, 0.1], [-0.5, 0.1, 0.0]]),
    (POINT.in_ee, [[-0.1, -0.2, 0.1], [-0.5, 0.1, 0.0]]),
    # From the base at (1, 2): (-0.1, 0.5) in the world, so 0.5 ahead and 0.1 left; heights stay.
    (POINT, [[0.4, -0.2, 1.1], [0.5, 0.1, 1.5]]),
    (handles_in_base(1), [[0.6, 0.1, 0.9], [0.9, -0.2, 0.7]]),
    # The hand's x is down, its y, the world's -x, is to the base's left.
    (EE_ROTATION, [[1, 0, 0, 0, 1, 0], [0, 0, -1, 0, 1, 0]]),
]


def test_entries_by_hand():
    for entry, expected in BY_HAND:
        assert np.allclose(entry.read(SHOT, None, GOALS), expected, atol=1e-5), entry.name


# The options ------------------------------------------------------------------------------------

FRONTS = ("OpenFridge", "CloseFridge", "OpenDrawer", "CloseDrawer")
START = ("object_start_from_ee", "object_start_in_ee")
TOLD = {
    "HabPick-v1": (*START, None),
    "HabPlace-v1": ("object_goal_from_ee", "object_goal_in_ee", None),
    "HabNavigate-v1": ("point_in_base", "point_in_ee", None),
    **{f"Hab{name}-v1": (*START, "handle_from_ee") for name in FRONTS},
    "HabTidyHouse-v1": ("targets_in_base", None, None),
    "HabPrepareGroceries-v1": ("targets_in_base", None, None),
    "HabSetTable-v1": ("targets_in_base", None, "handles_in_base"),
}
"""Environment -> what tells the target, the same with ``target_frame="ee"``, and the handle."""


def test_each_environment_has_the_options_that_make_sense():
    assert ENVS.keys() == TOLD.keys()
    for env_id, (default, in_ee, handle) in TOLD.items():
        env = ENVS[env_id].env
        cases = {(): [default], ("ee",): [in_ee], ("base", True): [default, handle]}
        for options, expected in cases.items():
            with pytest.raises(OptionError) if None in expected else nullcontext():
                entries = observed(env.observation, env.handle, FETCH, *options)
                assert [e.name for e in entries if e.group == "extra"] == expected, env_id
