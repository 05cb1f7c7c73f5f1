"""Success, failures and reward of closing a drawer on hand-made rows (App. H.2)."""

import pytest
import torch
from builders import evaluate_rules, measures, row

from hab_tasks.skills.close_drawer import CLOSE_DRAWER

TERMS = ["success", "handle", "joint"]
"""The equation's summands in its order."""


def test_pushing_and_success():
    m = measures(
        4,
        ee_to_handle_decrease_m=row(0.01, 0.004, -0.01, 0.0),
        grabbed_now=row(False, True, False, False),
        joint_increase=row(0.0, 0.0, -0.03, 0.02),
        joint=row(0.3, 0.3, 0.049, 0.06),
        ee_to_rest_m=row(0.6, 0.6, 0.149, 0.1),
        force_total_n=row(1e6, 0.0, 0.0, 0.0),
    )
    success, failures, terms, reward, _ = evaluate_rules(CLOSE_DRAWER, m)
    # Row 0 reaches: 0.01. Row 1 grabs the handle, which closing does not pay: 0.004.
    # Row 2 closes at rest: 10 - 0.01 + 0.03. Row 3 pulls it out: -0.02.
    assert torch.allclose(reward, row(0.01, 0.004, 10.02, -0.02))
    assert success.tolist() == [False, False, True, False]
    assert failures == {}
    assert torch.allclose(terms["joint"], row(0.0, 0.0, 0.03, -0.02))


def test_closed_is_within_5_cm_and_at_rest():
    m = measures(4, joint=row(0.049, 0.051, 0.0, 0.0), ee_to_rest_m=row(0.0, 0.0, 0.1499, 0.15))
    assert evaluate_rules(CLOSE_DRAWER, m).success.tolist() == [True, False, True, False]


def test_the_terms_stand_in_the_order_of_the_equation():
    assert list(evaluate_rules(CLOSE_DRAWER, measures(2)).terms) == TERMS


def test_the_gripper_is_free():
    gripper = row(-1.0, -0.2, 0.0, 0.7)
    m = measures(4, holding_handle=row(True, True, True, True))
    assert torch.equal(CLOSE_DRAWER.mask_gripper(gripper, m), gripper)


def test_no_step_pays_more_than_the_bound():
    m = measures(1, ee_to_handle_decrease_m=row(0.25), joint_increase=row(-0.5))
    # 10 + 0.25 + 0.5 = 10.75
    assert evaluate_rules(CLOSE_DRAWER, m).reward.item() == pytest.approx(10.75)
    assert CLOSE_DRAWER.reward_bound == 10.75
