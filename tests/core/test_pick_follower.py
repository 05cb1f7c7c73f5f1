"""The expert of Pick, against hand-worked actions."""

import math

import numpy as np
import pytest
from builders import reaching

from hab_tasks.skills.pick_follower import pick_action

FRIDGE = np.array([1.2, 0.0, math.pi])
"""It faces the robot: its axis is -x, and the hand is outside before x = 1.2 - 0.42 = 0.78."""


def test_the_hand_goes_straight_to_the_object_and_lifts_it_on_the_way_back():
    towards = pick_action(
        reaching((0.5, 0, 1.0), (0.8, 0.006, 0.9)), holds=False, nearest=True, fridge=None
    )
    assert towards == pytest.approx([1, 0.006 / 0.015, -1, -1], abs=1e-4)
    back = pick_action(
        reaching((0.8, 0, 0.9), (0.8, 0, 0.9)), holds=True, nearest=True, fridge=None
    )
    assert back == pytest.approx([-1, 0, 1, 1])  # to (0.5, 0, 1.0 + 0.1)


def test_the_hand_closes_where_the_target_is_the_nearest():
    for gap_m, nearest, grasps in ((0.08, True, 1), (0.10, True, -1), (0.08, False, -1)):
        near = reaching((0.8 - gap_m, 0, 0.9), (0.8, 0, 0.9))
        assert pick_action(near, holds=False, nearest=nearest, fridge=None)[3] == grasps


def test_before_the_fridge_the_hand_rises_then_turns_then_goes_in():
    target = (1.0, 0.2, 1.3)
    low = pick_action(reaching((0.7, 0, 1.0), target), holds=False, nearest=True, fridge=FRIDGE)
    # Up to 1.35 m at x = 0.78: along (0.08, 0, 0.35), the largest share 1.
    assert low[:3] == pytest.approx([0.08 / 0.35, 0, 1], abs=1e-4)
    high = pick_action(reaching((0.78, 0, 1.35), target), holds=False, nearest=True, fridge=FRIDGE)
    assert high[:3] == pytest.approx([0, 1, 0], abs=1e-4)
    ready = pick_action(
        reaching((0.78, 0.2, 1.35), target), holds=False, nearest=True, fridge=FRIDGE
    )
    assert ready[:3] == pytest.approx([1, 0, 0], abs=1e-4)


def test_a_hand_beside_the_line_leaves_the_fridge_first():
    # Inside, 0.15 m aside: back along the axis, to x = 0.78.
    beside = reaching((0.9, 0.05, 1.35), (1.0, 0.2, 1.3))
    action = pick_action(beside, holds=False, nearest=True, fridge=FRIDGE)
    assert action[:3] == pytest.approx([-1, 0, 0], abs=1e-4)


def test_the_object_leaves_the_fridge_along_its_axis():
    target = (0.9, 0.0, 1.3)
    inside = pick_action(reaching((0.9, 0, 1.3), target), holds=True, nearest=True, fridge=FRIDGE)
    # Out to x = 1.2 - 0.45 = 0.75, and 0.02 m further: (-0.17, 0, 0.01).
    assert inside == pytest.approx([-1, 0, 0.01 / 0.17, 1], abs=1e-4)
    outside = pick_action(reaching((0.74, 0, 1.3), target), holds=True, nearest=True, fridge=FRIDGE)
    assert outside == pytest.approx([-1, 0, -1, 1])
