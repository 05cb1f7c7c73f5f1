"""Success, failures and reward of opening a drawer on hand-made rows (App. H.2)."""

import pytest
import torch
from builders import evaluate_rules, measures, row

from hab_tasks.skills.open_drawer import OPEN_DRAWER

TERMS = ["success", "grabbed", "handle", "joint"]
"""The equation's summands in its order."""


def test_reaching_pulling_and_success():
    m = measures(
        4,
        ee_to_handle_decrease_m=row(0.01, 0.004, -0.01, 0.0),
        grabbed_now=row(False, True, False, False),
        joint_increase=row(0.0, 0.0, 0.03, -0.02),
        joint=row(0.0, 0.0, 0.27, 0.26),
        joint_share=row(0.0, 0.0, 0.9, 0.87),
        ee_to_rest_m=row(0.6, 0.6, 0.149, 0.1),
        force_n=row(1e5, 0.0, 0.0, 0.0),
        force_total_n=row(1e6, 0.0, 0.0, 0.0),
    )
    success, failures, terms, reward, _ = evaluate_rules(OPEN_DRAWER, m)
    # Row 0 reaches: 0.01, and no force is too much. Row 1 grabs: 5 + 0.004.
    # Row 2 opens at rest: 10 - 0.01 + 0.03. Row 3 pushes it back in: -0.02.
    assert torch.allclose(reward, row(0.01, 5.004, 10.02, -0.02))
    assert success.tolist() == [False, False, True, False]
    assert failures == {}
    assert torch.allclose(terms["grabbed"], row(0.0, 5.0, 0.0, 0.0))


def test_open_is_90_percent_and_at_rest():
    m = measures(
        4, joint_share=row(0.8999, 0.9001, 1.0, 1.0), ee_to_rest_m=row(0.0, 0.0, 0.1499, 0.15)
    )
    assert evaluate_rules(OPEN_DRAWER, m).success.tolist() == [False, True, True, False]


def test_the_terms_stand_in_the_order_of_the_equation():
    assert list(evaluate_rules(OPEN_DRAWER, measures(2)).terms) == TERMS


def test_the_gripper_is_free():
    gripper = row(-1.0, -0.2, 0.0, 0.7)
    m = measures(4, holding_handle=row(True, True, True, True))
    assert torch.equal(OPEN_DRAWER.mask_gripper(gripper, m), gripper)


def test_no_step_pays_more_than_the_bound():
    m = measures(
        1,
        joint_share=row(1.0),
        grabbed_now=row(True),
        ee_to_handle_decrease_m=row(0.25),
        joint_increase=row(0.5),
    )
    # 10 + 5 + 0.25 + 0.5 = 15.75
    assert evaluate_rules(OPEN_DRAWER, m).reward.item() == pytest.approx(15.75)
    assert OPEN_DRAWER.reward_bound == 15.75
