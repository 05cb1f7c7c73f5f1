"""Success, failures and reward of Place on hand-made rows (App. H.2)."""

import pytest
import torch
from builders import evaluate_rules, measures, row

from hab_tasks.skills.place import PLACE


def test_bringing_letting_go_and_success():
    m = measures(
        4,
        object_to_goal_decrease_m=row(0.01, 0.3, 0.0, 0.0),
        ee_to_rest_decrease_m=row(-0.02, 0.004, 0.015, 0.01),
        ee_to_rest_m=row(0.6, 0.5, 0.149, 0.149),
        holding_target=row(True, False, False, True),
        placed=row(False, True, True, False),
        placed_before=row(False, False, True, True),
        force_n=row(0.0, 100.0, 250.0, 0.0),
        force_total_n=row(0.0, 7400.0, 1000.0, 0.0),
    )
    success, failures, terms, reward, scores = evaluate_rules(PLACE, m)
    # Row 0 brings it: 20 * 0.01 = 0.2; the way back to rest is not paid while holding.
    # Row 1 lets go at the goal: 5 + 20 * 0.004 - 0.1 = 4.98; how far it fell is not paid.
    # Row 2 comes to rest: 20 + 20 * 0.015 - 0.25 = 20.05; placing is paid once only.
    # Row 3 holds it again, at rest: no success, nothing paid.
    assert torch.allclose(reward, row(0.2, 4.98, 20.05, 0.0))
    assert success.tolist() == [False, False, True, False]
    assert not failures["force"].any()
    assert torch.allclose(terms["place"], row(0.0, 5.0, 0.0, 0.0))
    assert torch.allclose(terms["approach"], row(0.2, 0.0, 0.0, 0.0))
    assert torch.allclose(terms["retract"], row(0.0, 0.08, 0.3, 0.0))
    order = "success place approach retract force force_exceeded wrong_object"
    assert list(terms) == order.split(), "not in the order of the equation"
    assert scores == {}


def test_wrong_object_and_force_exceeded():
    m = measures(
        3,
        placed=row(True, False, True),
        placed_before=row(True, False, True),
        holding_other=row(False, True, True),
        picked_other_now=row(False, True, False),
        ee_to_rest_m=row(0.1, 0.5, 0.5),
        force_n=row(3000.0, 0.0, 0.0),
        force_total_n=row(7500.1, 7500.0, 0.0),
    )
    success, failures, terms, reward, _ = evaluate_rules(PLACE, m)
    # Row 0: at rest and placed, but above 7,500 N: -1 (capped) - 10 = -11. Row 1: -5, and 7,500 N
    # are allowed. Row 2 still holds what it took before: it is paid for once.
    assert torch.allclose(reward, row(-11.0, -5.0, 0.0))
    assert not success.any()
    assert list(failures) == ["force"]
    assert failures["force"].tolist() == [True, False, False]
    assert torch.allclose(terms["wrong_object"], row(0.0, -5.0, 0.0))


def test_success_needs_object_and_hand_in_place():
    m = measures(
        4,
        placed=row(True, True, False, True),
        placed_before=row(True, True, True, False),
        ee_to_rest_m=row(0.1499, 0.15, 0.0, 0.1),
    )
    # Row 2's object has left the goal again.
    assert evaluate_rules(PLACE, m).success.tolist() == [True, False, False, True]


def test_nothing_is_grasped_once_the_object_is_placed():
    m = measures(
        4,
        placed=row(True, False, False, False),
        placed_before=row(False, True, False, False),
        holding_target=row(False, False, True, False),
    )
    for gripper in (-1.0, 0.0, 0.7):
        masked = PLACE.mask_gripper(torch.full((4,), gripper), m)
        assert bool((masked[:2] < 0).all())
        assert masked[2:].tolist() == pytest.approx([gripper, gripper])


def test_no_step_pays_more_than_the_bound():
    # The way of the object is paid while it is held and placing it afterwards, so the most is
    # success and placing at once, and a quarter of a metre: 20 + 5 + 20 * 0.25 = 30.
    m = measures(1, placed=row(True), ee_to_rest_decrease_m=row(0.25), ee_to_rest_m=row(0.0))
    assert evaluate_rules(PLACE, m).reward.item() == pytest.approx(30.0)
    assert PLACE.reward_bound == 30.0
