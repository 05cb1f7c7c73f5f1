"""Success, failures and reward of fridge and drawer on hand-made rows (App. H.2)."""

import math

import numpy as np
import pytest
import torch
from builders import evaluate_rules, goals_of, measures, row, snapshot

from hab_tasks.skills.close_drawer import CLOSE_DRAWER
from hab_tasks.skills.close_fridge import CLOSE_FRIDGE
from hab_tasks.skills.open_drawer import OPEN_DRAWER
from hab_tasks.skills.open_fridge import OPEN_FRIDGE

FRIDGE = (OPEN_FRIDGE, CLOSE_FRIDGE)

FRAME = torch.tensor([[[1.0, 2.0, math.pi / 2]]])
"""(1, 1, 3): the fridge at (1, 2) looks along the world's +y, its left is the world's -x."""


def before_the_fridge(*places):
    """Snapshot and goals with the bases at these places of the fridge's frame, ahead and left."""
    count = len(places)
    base = torch.tensor([[1.0 - left, 2.0 + ahead, 0.3] for ahead, left in places])
    goals = goals_of(count, 1, 1, articulation_frame=FRAME.expand(count, 1, 3))
    return snapshot(count, articulations=1, base=base), goals


AT_THE_FRIDGE = before_the_fridge(*[(1.4, 0.0)] * 4)


@pytest.mark.parametrize(
    ("skill", "joint", "increase", "grabbed", "success", "bound"),
    [
        # Joint and way of the row that succeeds: 10 - 0.01 for the hand, and the joint's way;
        # pi / 2 = 1.5708 is open. Grabbing the handle is not paid while closing.
        (OPEN_FRIDGE, 1.571, 0.05, 5.0, 10.04, 15.75),
        (CLOSE_FRIDGE, 0.149, -0.05, 0.0, 10.04, 10.75),
        (OPEN_DRAWER, 0.27, 0.03, 5.0, 10.02, 15.75),
        (CLOSE_DRAWER, 0.049, -0.03, 0.0, 10.02, 10.75),
    ],
    ids=["open fridge", "close fridge", "open drawer", "close drawer"],
)
def test_reaching_moving_and_success(skill, joint, increase, grabbed, success, bound):
    """Row 0 reaches, row 1 grabs, row 2 succeeds at rest, row 3 moves the joint the wrong way."""
    wrong_way = math.copysign(0.02, -increase)
    m = measures(
        4,
        ee_to_handle_decrease_m=row(0.01, 0.004, -0.01, 0.0),
        grabbed_now=row(False, True, False, False),
        grabbed_before=row(False, False, True, True),
        ee_to_rest_m=row(0.6, 0.6, 0.149, 0.1),
        force_n=row(1e5, 0.0, 0.0, 0.0),  # no force is too much
        force_total_n=row(1e6, 0.0, 0.0, 0.0),
        joint=row(0.8, 0.8, joint, 0.8),
        joint_share=row(0.0, 0.0, 0.9, 0.87),
        joint_increase=row(0.0, 0.0, increase, wrong_way),
    )
    found = evaluate_rules(skill, m, *AT_THE_FRIDGE)
    assert np.allclose(found.reward, row(0.01, grabbed + 0.004, success, -0.02))
    assert found.success.tolist() == [False, False, True, False]
    assert list(found.failures) == (["left_region"] if skill in FRIDGE else [])
    assert not any(failure.any() for failure in found.failures.values())
    # The most: success, grabbing where that is paid, 0.25 m of the hand and 0.5 of the joint.
    assert skill.reward_bound == bound
    gripper = row(-1.0, -0.2, 0.0, 0.7)
    held = measures(4, holding_handle=row(True, True, True, True))
    assert np.array_equal(skill.mask_gripper(gripper, held), gripper)


def test_the_region_is_a_rectangle_that_costs_10_to_leave_while_opening():
    # 0.933 + 0.9 = 1.833 m ahead; 0.6 m to both sides.
    inside = [(0.94, 0.0), (1.83, 0.0), (1.4, 0.59), (1.4, -0.59)]
    outside = [(0.92, 0.0), (1.84, 0.0), (1.4, 0.61), (1.4, -0.61), (-1.4, 0.0)]
    for skill, joint, paid in ((OPEN_FRIDGE, 2.0, -10.0), (CLOSE_FRIDGE, 0.1, 0.0)):
        grabbed = {"grabbed_before": row(*[True] * 9)}
        m = measures(9, joint=row(*[joint] * 9), ee_to_rest_m=row(*[0.1] * 9), **grabbed)
        found = evaluate_rules(skill, m, *before_the_fridge(*inside, *outside))
        left = [False] * 4 + [True] * 5
        assert found.failures["left_region"].tolist() == left, skill.name
        assert found.success.tolist() == [not flag for flag in left], skill.name
        assert np.allclose(found.reward, row(*[10.0] * 4, *[paid] * 5)), skill.name


def test_open_and_closed_are_beyond_their_thresholds_and_at_rest():
    angles = row(1.57, 1.5709, 2.3, 2.3)
    for skill, values in (
        (OPEN_FRIDGE, {"joint": angles, "joint_share": angles / 2.3}),
        (CLOSE_FRIDGE, {"joint": row(0.151, 0.149, 0.0, 0.0)}),
        (OPEN_DRAWER, {"joint_share": row(0.8999, 0.9001, 1.0, 1.0)}),
        (CLOSE_DRAWER, {"joint": row(0.051, 0.049, 0.0, 0.0)}),
    ):
        for holding in (True, False):
            values |= {"holding_handle": row(*[holding] * 4)}
            m = measures(4, ee_to_rest_m=row(0.0, 0.0, 0.1499, 0.15), **values)
            won = evaluate_rules(skill, m, *AT_THE_FRIDGE).success.tolist()
            by_hand = holding or skill is not CLOSE_FRIDGE
            assert won == [False, by_hand, by_hand, False], skill.name
