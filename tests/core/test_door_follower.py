"""The expert of the fridge, against hand-worked actions."""

import math

import numpy as np
import pytest
import torch
from builders import snapshot

from hab_tasks.articulations import FRIDGE
from hab_tasks.privileged import ArticulationState
from hab_tasks.skills.door_follower import _drive, door_action

REGION = FRIDGE.opening_region
FRAME = np.array([0.0, 0.0, 0.0])  # the fridge faces +x


def door(joint: float, *, held: bool) -> ArticulationState:
    """A door hinged at (0.4, 0.5); closed, its handle is 0.6 m aside, at (0.4, -0.1)."""
    return ArticulationState(
        kind="fridge",
        body="fridge/door",
        handle_m=np.array([0.4 + 0.6 * math.sin(joint), 0.5 - 0.6 * math.cos(joint), 1.2]),
        held=held,
        joint=joint,
        limits=(0.0, 2.3),
        slides=False,
        axis=np.array([0.0, 0.0, 1.0]),
        axis_point_m=np.array([0.4, 0.5, 0.0]),
        frame=FRAME,
    )


def facing(x_m: float, y_m: float, hand_m: tuple[float, float, float]):
    """A robot at (x, y) that faces the fridge, with the hand at a point of the base frame."""
    turned = torch.diag(torch.tensor([-1.0, -1.0, 1.0]))
    hand = torch.tensor([hand_m])
    return snapshot(
        base=torch.tensor([[x_m, y_m, math.pi]]),
        base_axes=turned[None],
        ee_m=torch.tensor([[x_m, y_m, 0.0]]) + hand @ turned,
        ee_in_base_m=hand,
    )


def test_the_hand_goes_straight_to_the_handle_and_closes_before_it():
    # The handle at (0.4, -0.1, 1.2) is 1.0 m ahead of a base at (1.4, -0.1).
    action = door_action(facing(1.4, -0.1, (0.9, 0.0, 1.19)), door(0.0, held=False), opens=True)
    assert action[:3] == pytest.approx([1, 0, 0.01 / 0.015], abs=1e-5)
    assert action[3] == -1  # 0.1005 m away
    # 9 x (1.0 - 0.8) m is more than the largest share; nothing is aside.
    assert action[4:] == pytest.approx([0.6, 0], abs=1e-5)
    near = door_action(facing(1.4, -0.1, (0.95, 0.0, 1.19)), door(0.0, held=False), opens=True)
    assert near[3] == 1


def test_a_held_door_is_moved_along_its_arc():
    # After 0.15 rad: (0.4 + 0.6 sin 0.15, 0.5 - 0.6 cos 0.15) = (0.4897, -0.0933); a base at
    # (1.05, -0.1) that faces it sees it at (0.5603, -0.0067).
    action = door_action(facing(1.05, -0.1, (0.57, 0.0, 1.2)), door(0.0, held=True), opens=True)
    assert action[:4] == pytest.approx([-0.0097 / 0.015, -0.0067 / 0.015, 0, 1], abs=0.01)
    # 9 x (0.5604 - 0.65) = -0.8, at most 0.6 backwards; 1.43 x atan(-0.0067 / 0.5603) = -0.017.
    assert action[4:] == pytest.approx([-0.6, -0.017], abs=0.001)
    closing = door_action(facing(1.05, -0.1, (0.57, 0, 1.2)), door(0.3, held=True), opens=False)
    # From 0.3 rad the same point, 0.15 rad, is ahead.
    assert closing[:3] == pytest.approx(action[:3], abs=1e-6)


def test_a_door_that_is_far_enough_is_let_go():
    for joint, held, opens, rests in (
        (1.60, True, True, False),  # pi/2 + 0.08 = 1.651
        (1.66, True, True, True),
        (1.59, False, True, False),  # pi/2 + 0.03 = 1.601
        (1.61, False, True, True),
        (0.07, True, False, False),
        (0.05, True, False, True),
        (0.11, False, False, True),
    ):
        action = door_action(facing(1.4, 0.0, (0.8, 0, 1.0)), door(joint, held=held), opens=opens)
        # From (0.8, 0, 1.0) to the resting position (0.5, 0, 1.0).
        assert (action == pytest.approx([-1, 0, 0, -1, 0, 0])) == rests, (joint, held, opens)
        assert bool(action[4:].any()) != rests, (joint, held, opens)


def test_the_base_does_not_leave_its_region():
    ahead, right = np.array([0.4, 0.0, 0.0]), math.pi - math.pi / 4
    # The far side of the region is at x = 1.833; 0.05 m before it, the base drives ahead instead of
    # back, and 0.05 m before the near one, at 0.933, it backs away although it is near enough.
    assert _drive(np.array([1.78, 0, math.pi]), ahead, 0.65, FRAME, REGION)[0] == 0.15
    assert _drive(np.array([1.70, 0, math.pi]), ahead, 0.65, FRAME, REGION)[0] == -0.6
    assert _drive(np.array([0.98, 0, math.pi]), ahead, 0.40, FRAME, REGION)[0] == -0.15
    # At y = -0.5, backing away with the heading 135 degrees would bring it nearer to -0.6.
    forward, turn = _drive(np.array([1.4, -0.5, right]), ahead, 0.65, FRAME, REGION)
    assert forward == 0.15
    assert turn == 0.6  # 2.86 x 45 degrees is more
