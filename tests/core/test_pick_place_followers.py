"""The experts of Pick and of Place, against hand-worked actions."""

import math

import numpy as np
import pytest
from builders import reaching

from hab_tasks.skills.pick_follower import pick_action
from hab_tasks.skills.place_follower import place_action

FRIDGE = np.array([1.2, 0.0, math.pi])
"""It faces the robot: its axis is -x, and the hand is outside before x = 1.2 - 0.42 = 0.78."""

OPEN, SHELF = (0.8, 0, 0.9), (1.0, 0.2, 1.3)
GOAL, SHELF_GOAL = (0.9, 0.2, 0.85), (1.0, 0.0, 1.3)


def test_pick_goes_straight_or_along_the_fridges_axis():
    for hand_m, object_m, holds, fridge, expected in (
        ((0.5, 0, 1.0), (0.8, 0.006, 0.9), False, None, [1, 0.006 / 0.015, -1, -1]),
        (OPEN, OPEN, True, None, [-1, 0, 1, 1]),  # to (0.5, 0, 1.0 + 0.1)
        # Up to 1.35 m at x = 0.78: along (0.08, 0, 0.35), the largest share 1; aside; in.
        ((0.7, 0, 1.0), SHELF, False, FRIDGE, [0.08 / 0.35, 0, 1, -1]),
        ((0.78, 0, 1.35), SHELF, False, FRIDGE, [0, 1, 0, -1]),
        ((0.78, 0.2, 1.35), SHELF, False, FRIDGE, [1, 0, 0, -1]),
        # Inside, 0.15 m aside: back along the axis, to x = 0.78.
        ((0.9, 0.05, 1.35), SHELF, False, FRIDGE, [-1, 0, 0, -1]),
        # Out to x = 1.2 - 0.45 = 0.75, and 0.02 m further: (-0.17, 0, 0.01).
        ((0.9, 0, 1.3), (0.9, 0, 1.3), True, FRIDGE, [-1, 0, 0.01 / 0.17, 1]),
        ((0.74, 0, 1.3), (0.9, 0, 1.3), True, FRIDGE, [-1, 0, -1, 1]),
    ):
        state = reaching(hand_m, object_m)
        action = pick_action(state, holds=holds, nearest=True, fridge=fridge)
        assert action == pytest.approx(expected, abs=1e-4)
    for gap_m, nearest, grasps in ((0.08, True, 1), (0.10, True, -1), (0.08, False, -1)):
        near = reaching((0.8 - gap_m, 0, 0.9), OPEN)
        assert pick_action(near, holds=False, nearest=nearest, fridge=None)[3] == grasps


def test_place_lowers_the_object_and_rises_or_leaves_along_the_fridges_axis():
    for hand_m, object_m, goal, holds, expected in (
        # The object's place counts, which is (0.05, 0, -0.07) off the hand: 0.006 m below the point
        # 0.08 m above the goal, 0.1 m before it; 0.02 m before it, down; 0.028 m away, released.
        ((0.75, 0.2, 0.994), (0.8, 0.2, 0.924), GOAL, True, [1, 0, 0.006 / 0.015, 1]),
        ((0.83, 0.2, 1.0), (0.88, 0.2, 0.93), GOAL, True, [1, 0, -1, 1]),
        ((0.83, 0.2, 0.94), (0.88, 0.2, 0.87), GOAL, True, [1, 0, -1, -1]),
        ((0.9, 0.2, 0.87), GOAL, GOAL, False, [-1, -1, 1, -1]),
        ((0.5, 0, 1.006), GOAL, GOAL, False, [0, 0, -0.006 / 0.015, -1]),  # to rest
        # In the fridge; out to x = 0.75, and 0.02 m further: (-0.22, 0, 0.01).
        ((0.78, 0, 1.33), (0.78, 0, 1.33), SHELF_GOAL, True, [1, 0, 0, 1]),
        ((0.95, 0, 1.33), (0.95, 0, 1.33), SHELF_GOAL, False, [-1, 0, 0.01 / 0.22, -1]),
    ):
        fridge = FRIDGE if goal is SHELF_GOAL else None
        action = place_action(
            reaching(hand_m, object_m), np.array(goal), holds=holds, fridge=fridge
        )
        assert action == pytest.approx(expected, abs=1e-3 if fridge is None else 1e-4)
    inside = reaching((0.95, 0, 1.33), (0.95, 0, 1.33))  # 0.058 m from the goal: released
    assert place_action(inside, np.array(SHELF_GOAL), holds=True, fridge=FRIDGE)[3] == -1
