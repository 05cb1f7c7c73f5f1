"""Success, failures and reward of opening the fridge on hand-made rows (App. H.2)."""

import math
from dataclasses import replace

import pytest
import torch
from builders import evaluate_rules, measures, row, snapshot

from hab_tasks.engine.goals import Goals
from hab_tasks.skills.open_fridge import OPEN_FRIDGE as SKILL

TERMS = ["success", "grabbed", "handle", "joint", "left_region"]
"""The equation's summands in its order."""

FRAME = torch.tensor([[[1.0, 2.0, math.pi / 2]]])
"""(1, 1, 3): the fridge at (1, 2) looks along the world's +y, its left is the world's -x."""


def before_the_fridge(*places):
    """Snapshot and goals with the bases at these places of the fridge's frame, ahead and left."""
    base = torch.tensor([[1.0 - left, 2.0 + ahead, 0.3] for ahead, left in places])
    goals = Goals.empty(len(places), 1, 1, "cpu")
    frame = FRAME.expand(len(places), 1, 3).contiguous()
    return snapshot(len(places), articulations=1, base=base), replace(
        goals, articulation_frame=frame
    )


def test_reaching_pulling_and_success():
    s, g = before_the_fridge(*[(1.4, 0.0)] * 4)
    m = measures(
        4,
        ee_to_handle_decrease_m=row(0.01, 0.004, -0.01, 0.0),
        grabbed_now=row(False, True, False, False),
        joint_increase=row(0.0, 0.0, 0.05, -0.02),
        joint=row(0.0, 0.0, 1.571, 1.5),
        ee_to_rest_m=row(0.6, 0.6, 0.149, 0.1),
        force_n=row(1e5, 0.0, 0.0, 0.0),
        force_total_n=row(1e6, 0.0, 0.0, 0.0),
    )
    success, failures, terms, reward, _ = evaluate_rules(SKILL, m, s, g)
    # Row 0 reaches: 1 * 0.01, and no force is too much. Row 1 grabs: 5 + 0.004.
    # Row 2 opens beyond pi / 2 = 1.5708 at rest: 10 - 0.01 + 0.05. Row 3 lets the door fall to.
    assert torch.allclose(reward, row(0.01, 5.004, 10.04, -0.02))
    assert success.tolist() == [False, False, True, False]
    assert list(failures) == ["left_region"]
    assert not failures["left_region"].any()
    assert torch.allclose(terms["joint"], row(0.0, 0.0, 0.05, -0.02))
    assert torch.allclose(terms["handle"], row(0.01, 0.004, -0.01, 0.0))


def test_leaving_the_region_costs_10_and_is_no_success():
    s, g = before_the_fridge((1.4, 0.0), (0.9, 0.0))
    m = measures(2, joint=row(2.0, 2.0), ee_to_rest_m=row(0.1, 0.1))
    success, failures, _, reward, _ = evaluate_rules(SKILL, m, s, g)
    assert success.tolist() == [True, False]
    assert failures["left_region"].tolist() == [False, True]
    assert torch.allclose(reward, row(10.0, -10.0))


def test_the_region_is_a_rectangle_of_90_by_120_cm():
    # 0.933 + 0.9 = 1.833 m ahead; 0.6 m to both sides.
    places = [
        (0.94, 0.0),
        (0.92, 0.0),
        (1.83, 0.0),
        (1.84, 0.0),
        (1.4, 0.59),
        (1.4, 0.61),
        (1.4, -0.59),
        (1.4, -0.61),
        (-1.4, 0.0),
    ]
    s, g = before_the_fridge(*places)
    left = evaluate_rules(SKILL, measures(len(places)), s, g).failures["left_region"]
    assert left.tolist() == [False, True, False, True, False, True, False, True, True]


def test_open_is_more_than_90_degrees_and_at_rest():
    s, g = before_the_fridge(*[(1.4, 0.0)] * 4)
    angles, rest = row(1.57, 1.5709, 2.3, 2.3), row(0.0, 0.0, 0.1499, 0.15)
    m = measures(4, joint=angles, joint_share=angles / 2.3, ee_to_rest_m=rest)
    assert evaluate_rules(SKILL, m, s, g).success.tolist() == [False, True, True, False]


def test_the_terms_stand_in_the_order_of_the_equation():
    assert list(evaluate_rules(SKILL, measures(2)).terms) == TERMS


def test_the_gripper_is_free():
    gripper = row(-1.0, -0.2, 0.0, 0.7)
    m = measures(4, holding_handle=row(True, True, True, True))
    assert torch.equal(SKILL.mask_gripper(gripper, m), gripper)


def test_no_step_pays_more_than_the_bound():
    s, g = before_the_fridge((1.4, 0.0))
    m = measures(
        1,
        joint=row(2.0),
        grabbed_now=row(True),
        ee_to_handle_decrease_m=row(0.25),
        joint_increase=row(0.5),
    )
    # 10 + 5 + 0.25 + 0.5 = 15.75
    assert evaluate_rules(SKILL, m, s, g).reward.item() == pytest.approx(15.75)
    assert SKILL.reward_bound == 15.75
