"""The expert of drawers, against hand-worked actions."""

import numpy as np
import pytest
import torch
from builders import snapshot

from hab_tasks.privileged import ArticulationState
from hab_tasks.skills.drawer_follower import drawer_action


def drawer(joint: float, *, held: bool) -> ArticulationState:
    """A drawer that opens towards -x; closed, its handle is at (0.9, 0, 0.56)."""
    return ArticulationState(
        kind="drawer",
        body="counter/drawer",
        handle_m=np.array([0.9 - joint, 0.0, 0.56]),
        held=held,
        joint=joint,
        limits=(0.0, 0.5),
        slides=True,
        axis=np.array([-1.0, 0.0, 0.0]),
        axis_point_m=np.zeros(3),
        frame=np.zeros(3),
    )


def hand_at(x_m: float, y_m: float, z_m: float):
    """A robot at the origin that faces +x, with the hand at a point."""
    hand = torch.tensor([[x_m, y_m, z_m]])
    return snapshot(
        base=torch.zeros(1, 3), base_axes=torch.eye(3)[None], ee_m=hand, ee_in_base_m=hand
    )


def test_the_hand_goes_straight_to_the_handle_and_closes_before_it():
    action = drawer_action(hand_at(0.8, 0.003, 0.56), drawer(0.0, held=False), opens=True)
    # 0.1 m ahead, 0.003 m aside; opening, it closes within 0.07 m.
    assert action == pytest.approx([1, -0.003 / 0.015, 0, -1], abs=1e-5)
    assert drawer_action(hand_at(0.86, 0, 0.56), drawer(0.0, held=False), opens=True)[3] == 1
    assert drawer_action(hand_at(0.41, 0, 0.56), drawer(0.4, held=False), opens=False)[3] == 1


def test_to_open_a_drawer_the_hand_comes_from_before_its_handle():
    # 0.05 m above the axis: to 0.15 m before the handle, (0.75, 0, 0.56), from (0.75, 0, 0.61).
    beside = drawer_action(hand_at(0.75, 0, 0.61), drawer(0.0, held=False), opens=True)
    assert beside == pytest.approx([0, 0, -1, -1], abs=1e-4)
    in_line = drawer_action(hand_at(0.75, 0, 0.59), drawer(0.0, held=False), opens=True)
    assert in_line == pytest.approx([1, 0, -1, -1], abs=1e-4)


def test_a_held_drawer_is_moved_along_its_axis():
    # The handle at (0.8, 0, 0.56), the hand on it: 0.14 m ahead is a full step towards -x.
    state = hand_at(0.8, 0.0, 0.56)
    opening = drawer_action(state, drawer(0.1, held=True), opens=True)
    assert opening == pytest.approx([-1, 0, 0, 1], abs=1e-5)
    closing = drawer_action(state, drawer(0.1, held=True), opens=False)
    assert closing == pytest.approx([1, 0, 0, 1], abs=1e-5)


def test_a_hand_beside_the_axis_first_goes_to_the_handle():
    # 0.06 m above: a quarter of the way ahead is left, 0.035 m, and the hand is 0.035 m too far.
    state = hand_at(0.835, 0.0, 0.62)
    closing = drawer_action(state, drawer(0.1, held=True), opens=False)
    assert closing == pytest.approx([0, 0, -1, 1], abs=1e-5)
    # 0.09 m above, it goes to the handle alone.
    higher = drawer_action(hand_at(0.809, 0, 0.65), drawer(0.1, held=True), opens=False)
    assert higher == pytest.approx([-0.009 / 0.015, 0, -1, 1], abs=1e-5)


def test_a_closed_drawer_is_let_go_when_the_hand_has_moved_past_the_handle():
    for beyond_m, lets_go in ((0.02, False), (0.04, True)):
        pushed = hand_at(0.89 + beyond_m, 0, 0.56)
        action = drawer_action(pushed, drawer(0.01, held=True), opens=False)
        # Its handle is at 0.89 m; resting, the hand goes back, up and opens.
        assert action[3] == (-1 if lets_go else 1), beyond_m
        assert action[0] == pytest.approx(-1 if lets_go else 1), beyond_m


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
        action = drawer_action(hand_at(0.6, 0, 0.7), drawer(joint, held=held), opens=opens)
        # From (0.6, 0, 0.7) to the resting position (0.5, 0, 1.0).
        assert (action == pytest.approx([-1, 0, 1, -1])) == rests, (joint, held, opens)
