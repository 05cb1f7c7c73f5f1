"""The expert of Place, against hand-worked actions."""

import math

import numpy as np
import pytest
from builders import reaching

from hab_tasks.skills.place_follower import place_action

GOAL = np.array([0.9, 0.2, 0.85])
FRIDGE = np.array([1.2, 0.0, math.pi])


def test_the_object_is_lowered_onto_its_goal_and_released():
    for (x, y, z), expected in (
        # 0.006 m below the point 0.08 m above the goal, 0.1 m before it.
        ((0.8, 0.2, 0.924), [1, 0, 0.006 / 0.015, 1]),
        ((0.88, 0.2, 0.93), [1, 0, -1, 1]),  # 0.02 m before it: down to the goal
        ((0.88, 0.2, 0.87), [1, 0, -1, -1]),  # 0.028 m away: released
    ):
        hand_m = (x - 0.05, y, z + 0.07)  # the object's own place counts
        action = place_action(reaching(hand_m, (x, y, z)), GOAL, holds=True, fridge=None)
        assert action == pytest.approx(expected, abs=1e-3)


def test_the_empty_hand_rises_before_it_leaves():
    low = place_action(reaching((0.9, 0.2, 0.87), (0.9, 0.2, 0.85)), GOAL, holds=False, fridge=None)
    assert low == pytest.approx([-1, -1, 1, -1])
    # From (0.5, 0.0, 1.006) to rest, far from the goal.
    far = place_action(
        reaching((0.5, 0.0, 1.006), (0.9, 0.2, 0.85)), GOAL, holds=False, fridge=None
    )
    assert far == pytest.approx([0, 0, -0.006 / 0.015, -1], abs=1e-3)


def test_in_the_fridge_the_object_goes_in_and_the_hand_out_along_its_axis():
    goal = np.array([1.0, 0.0, 1.3])
    ready = reaching((0.78, 0.0, 1.33), (0.78, 0.0, 1.33))
    assert place_action(ready, goal, holds=True, fridge=FRIDGE) == pytest.approx(
        [1, 0, 0, 1], abs=1e-4
    )
    inside = reaching((0.95, 0.0, 1.33), (0.95, 0.0, 1.33))
    # 0.058 m from the goal: released.
    assert place_action(inside, goal, holds=True, fridge=FRIDGE)[3] == -1
    # Out to x = 0.75, and 0.02 m further: (-0.22, 0, 0.01).
    leaving = place_action(inside, goal, holds=False, fridge=FRIDGE)
    assert leaving == pytest.approx([-1, 0, 0.01 / 0.22, -1], abs=1e-4)
