"""Doors and drawers: thresholds (App. H.2), and their experts against hand-worked actions."""

import math

import numpy as np
import pytest
import torch
from builders import reaching, snapshot

from hab_tasks.articulations import DRAWER, FRIDGE
from hab_tasks.privileged import ArticulationState
from hab_tasks.skills.door_follower import door_action
from hab_tasks.skills.drawer_follower import drawer_action


def kinds_of(*values):
    """The same numbers as a batch of tensors and as one of arrays."""
    return torch.tensor(values), np.array(values)


def test_the_fridge_is_open_beyond_90_degrees_and_closed_within_015_rad():
    for joint in kinds_of(0.0, math.pi / 2 - 1e-3, math.pi / 2 + 1e-3, 2.3):
        for travel in (1.6, 2.6):  # which does not matter
            assert FRIDGE.is_open(joint, joint / travel).tolist() == [False, False, True, True]
    for joint in kinds_of(0.0, 0.149, 0.151, math.pi / 2, -0.01):
        assert FRIDGE.is_closed(joint).tolist() == [True, True, False, False, True]


def test_a_drawer_is_open_from_90_percent_of_its_travel_and_closed_within_5_cm():
    travels = kinds_of(0.3, 0.3, 0.3, 0.3, 0.4)
    for joint, travel in zip(kinds_of(0.0, 0.269, 0.271, 0.3, 0.271), travels, strict=True):
        # 0.271 / 0.4 = 68 %
        assert DRAWER.is_open(joint, joint / travel).tolist() == [False, False, True, True, False]
    for joint in kinds_of(0.0, 0.049, 0.051, 0.3):
        assert DRAWER.is_closed(joint).tolist() == [True, True, False, False]


def front(kind, joint, held, handle_m, limit, axis, axis_point_m):
    return ArticulationState(
        kind=kind,
        body=kind,
        handle_m=np.array(handle_m),
        held=held,
        joint=joint,
        limits=(0.0, limit),
        slides=kind == "drawer",
        axis=np.array(axis),
        axis_point_m=np.array(axis_point_m),
        frame=np.zeros(3),  # the fridge faces +x
    )


def drawer_step(hand_m, joint, *, held, opens):
    """The action for a drawer that opens towards -x; closed, its handle is at (0.9, 0, 0.56)."""
    handle_m = (0.9 - joint, 0.0, 0.56)
    drawer = front("drawer", joint, held, handle_m, 0.5, (-1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    return drawer_action(reaching(hand_m, handle_m), drawer, opens=opens)


def test_the_hand_goes_to_a_drawers_handle_and_moves_it_along_its_axis():
    for hand_m, joint, held, opens, action in (
        # 0.1 m ahead, 0.003 m aside; opening, it closes within 0.07 m.
        ((0.8, 0.003, 0.56), 0.0, False, True, [1, -0.003 / 0.015, 0, -1]),
        ((0.86, 0.0, 0.56), 0.0, False, True, [1, 0, 0, 1]),
        # 0.05 m above the axis: to 0.15 m before the handle, (0.75, 0, 0.56), from (0.75, 0, 0.61).
        ((0.75, 0.0, 0.61), 0.0, False, True, [0, 0, -1, -1]),
        ((0.75, 0.0, 0.59), 0.0, False, True, [1, 0, -1, -1]),
        # The handle at (0.8, 0, 0.56), the hand on it: 0.14 m ahead is a full step towards -x.
        ((0.8, 0.0, 0.56), 0.1, True, True, [-1, 0, 0, 1]),
        ((0.8, 0.0, 0.56), 0.1, True, False, [1, 0, 0, 1]),
        # 0.06 m above: a quarter of the way ahead is left, 0.035 m, and the hand is that too far.
        ((0.835, 0.0, 0.62), 0.1, True, False, [0, 0, -1, 1]),
        # 0.09 m above, it goes to the handle alone.
        ((0.809, 0.0, 0.65), 0.1, True, False, [-0.009 / 0.015, 0, -1, 1]),
    ):
        found = drawer_step(hand_m, joint, held=held, opens=opens)
        assert found == pytest.approx(action, abs=1e-4), (hand_m, opens)


def test_a_drawer_that_is_far_enough_is_let_go():
    for joint, held, opens, rests in (
        (0.457, True, True, False),  # 0.915 of 0.5 m is 0.4575 m
        (0.458, True, True, True),
        (0.452, False, True, False),  # 0.905 of it is 0.4525 m
        (0.453, False, True, True),
        (0.021, True, False, False),
        (0.041, False, False, False),
        (0.039, False, False, True),
    ):
        action = drawer_step((0.6, 0.0, 0.7), joint, held=held, opens=opens)
        # From (0.6, 0, 0.7) to the resting position (0.5, 0, 1.0).
        assert (action == pytest.approx([-1, 0, 1, -1])) == rests, (joint, held, opens)
    for beyond_m, lets_go in ((0.02, False), (0.04, True)):
        # Closed: when the hand has moved past the handle, at 0.89 m.
        pushed = drawer_step((0.89 + beyond_m, 0.0, 0.56), 0.01, held=True, opens=False)
        assert pushed[3] == (-1 if lets_go else 1), beyond_m


def door_step(x_m, y_m, hand_m, joint, *, held, opens):
    """The action of a robot at (x, y) that faces the fridge, the hand at a point of its base frame.

    The door is hinged at (0.4, 0.5); closed, its handle is 0.6 m aside, at (0.4, -0.1).
    """
    turned, hand = torch.diag(torch.tensor([-1.0, -1.0, 1.0])), torch.tensor([hand_m])
    state = snapshot(
        base=torch.tensor([[x_m, y_m, math.pi]]),
        base_axes=turned[None],
        ee_m=torch.tensor([[x_m, y_m, 0.0]]) + hand @ turned,
        ee_in_base_m=hand,
    )
    handle_m = (0.4 + 0.6 * math.sin(joint), 0.5 - 0.6 * math.cos(joint), 1.2)
    door = front("fridge", joint, held, handle_m, 2.3, (0.0, 0.0, 1.0), (0.4, 0.5, 0.0))
    return door_action(state, door, opens=opens)


def test_the_hand_goes_straight_to_the_doors_handle_and_closes_before_it():
    # The handle at (0.4, -0.1, 1.2) is 1.0 m ahead of a base at (1.4, -0.1).
    action = door_step(1.4, -0.1, (0.9, 0.0, 1.19), 0.0, held=False, opens=True)
    # Open 0.1005 m away; 9 x (1.0 - 0.8) m is more than the largest share; nothing is aside.
    assert action == pytest.approx([1, 0, 0.01 / 0.015, -1, 0.6, 0], abs=1e-5)
    assert door_step(1.4, -0.1, (0.95, 0.0, 1.19), 0.0, held=False, opens=True)[3] == 1


def test_a_held_door_is_moved_along_its_arc():
    # After 0.15 rad: (0.4 + 0.6 sin 0.15, 0.5 - 0.6 cos 0.15) = (0.4897, -0.0933); a base at
    # (1.05, -0.1) that faces it sees it at (0.5603, -0.0067).
    action = door_step(1.05, -0.1, (0.57, 0.0, 1.2), 0.0, held=True, opens=True)
    assert action[:4] == pytest.approx([-0.0097 / 0.015, -0.0067 / 0.015, 0, 1], abs=0.01)
    # 9 x (0.5604 - 0.65) = -0.8, at most 0.6 backwards; 1.43 x atan(-0.0067 / 0.5603) = -0.017.
    assert action[4:] == pytest.approx([-0.6, -0.017], abs=0.001)
    # From 0.3 rad the same point, 0.15 rad, is ahead.
    closing = door_step(1.05, -0.1, (0.57, 0.0, 1.2), 0.3, held=True, opens=False)
    assert closing[:3] == pytest.approx(action[:3], abs=1e-6)
