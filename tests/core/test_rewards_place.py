"""Success, failures and reward of Place on hand-made rows (App. H.2)."""

import numpy as np
import pytest
import torch
from builders import evaluate_rules, measures, row

from hab_tasks.skills.place import PLACE


def test_reward_success_and_failures():
    m = measures(
        7,
        object_to_goal_decrease_m=row(0.01, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0),
        ee_to_rest_decrease_m=row(-0.02, 0.004, 0.015, 0.01, 0.0, 0.0, 0.0),
        ee_to_rest_m=row(0.6, 0.5, 0.149, 0.149, 0.1, 0.5, 0.5),
        holding_target=row(True, False, False, True, False, False, False),
        holding_other=row(False, False, False, False, False, True, True),
        picked_other_now=row(False, False, False, False, False, True, False),
        placed=row(False, True, True, False, True, False, True),
        placed_before=row(False, False, True, True, True, False, True),
        force_n=row(0.0, 100.0, 250.0, 0.0, 3000.0, 0.0, 0.0),
        force_total_n=row(0.0, 7400.0, 1000.0, 0.0, 7500.1, 7500.0, 0.0),
    )
    success, failures, _, reward, _ = evaluate_rules(PLACE, m)
    # Row 0 brings it: 20 * 0.01 = 0.2; the way back to rest is not paid while holding.
    # Row 1 lets go at the goal: 5 + 20 * 0.004 - 0.1 = 4.98; how far it fell is not paid.
    # Row 2 comes to rest: 20 + 20 * 0.015 - 0.25 = 20.05; placing is paid once only.
    # Row 3 holds it again, at rest: no success, nothing paid.
    # Row 4: at rest and placed, but above 7,500 N: -1 (capped) - 10 = -11. Row 5 takes another: -5,
    # and 7,500 N are allowed. Row 6 still holds what it took before: it is paid for once.
    assert np.allclose(reward, row(0.2, 4.98, 20.05, 0.0, -11.0, -5.0, 0.0))
    assert success.tolist() == [number == 2 for number in range(7)]
    assert list(failures) == ["force"]
    assert failures["force"].tolist() == [number == 4 for number in range(7)]
    # At most a quarter of a metre in a step, placing and success at once: 20 + 5 + 20 * 0.25.
    assert PLACE.reward_bound == 30.0


def test_success_needs_object_and_hand_in_place():
    m = measures(
        4,
        placed=row(True, True, False, True),
        placed_before=row(True, True, True, False),
        ee_to_rest_m=row(0.1499, 0.15, 0.0, 0.1),
    )
    # Row 2's object has left the goal again.
    assert evaluate_rules(PLACE, m).success.tolist() == [True, False, False, True]


def test_nothing_is_grasped_once_the_object_is_released_at_its_goal():
    m = measures(
        3,
        released=row(True, False, False),
        released_before=row(False, True, False),
        holding_target=row(False, False, True),
    )
    for gripper in (-1.0, 0.7):
        masked = PLACE.mask_gripper(torch.full((3,), gripper), m)
        assert bool((masked[:2] < 0).all())
        assert masked[2].item() == pytest.approx(gripper)
