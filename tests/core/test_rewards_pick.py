"""Success, failures, reward and score of Pick on hand-made rows (App. C, E.2, F.2, H.2)."""

import numpy as np
import pytest
import torch
from builders import evaluate_rules, measures, row

from hab_tasks.engine.rules import force_penalty
from hab_tasks.skills.pick import PICK


def test_reward_success_and_failures():
    m = measures(
        6,
        ee_to_object_decrease_m=row(0.01, 0.02, 0.5, 0.01, -0.02, 0.0),
        ee_to_rest_decrease_m=row(-0.03, 0.004, 0.015, 0.0, 0.0, 0.0),
        ee_to_rest_m=row(0.1, 0.6, 0.149, 0.5, 0.5, 0.1),
        holding_target=row(False, True, True, False, False, True),
        holding_other=row(False, False, False, True, False, False),
        picked_now=row(False, True, False, False, False, False),
        dropped_now=row(False, False, False, False, True, False),
        force_n=row(0.0, 100.0, 250.0, 0.0, 999.0, 3000.0),
        force_total_n=row(0.0, 4900.0, 1000.0, 0.0, 5000.0, 5000.1),
    )
    success, failures, _, reward, _ = evaluate_rules(PICK, m)
    # Row 0 approaches: 20 * 0.01 = 0.2; being near rest without the object is no success.
    # Row 1 picks up: 5 + 20 * 0.004 - 0.001 * 100 = 5 + 0.08 - 0.1 = 4.98.
    # Row 2 succeeds: 20 + 20 * 0.015 - 0.25 = 20.05.
    # Row 3 takes another: 0.2 - 5 = -4.8. Row 4 drops it: 20 * -0.02 - 0.999 - 5 = -6.399.
    # Row 5: at rest with the target, but above 5,000 N: -1 (capped) - 10 = -11, no success.
    assert np.allclose(reward, row(0.2, 4.98, 20.05, -4.8, -6.399, -11.0))
    assert success.tolist() == [False, False, True, False, False, False]
    assert {name: np.flatnonzero(f).tolist() for name, f in failures.items()} == {
        "force": [5],
        "wrong_object": [3],
        "dropped_object": [4],
    }
    # At most a quarter of a metre in a step: 20 + 5 + 20 * 0.25.
    assert PICK.reward_bound == 30.0


def test_the_force_penalty_is_capped():
    # 0.001 * 1000 is just the cap.
    force = row(0.0, 1.0, 1000.0, 1001.0, 1e6)
    assert np.allclose(force_penalty(force, 0.001, 1.0), row(0.0, -0.001, -1.0, -1.0, -1.0))


def test_success_at_rest_within_15_cm_and_its_sct():
    # From 0.6 m away, an oracle takes 2 * 0.6 / 0.015 = 80 steps.
    m = measures(
        4,
        ee_to_object_start_m=row(0.6, 0.6, 0.6, 0.6),
        ee_to_rest_m=row(0.0, 0.1, 0.1499, 0.15),
        steps=row(160.0, 80.0, 50.0, 160.0),
        holding_target=row(True, True, True, True),
    )
    found = evaluate_rules(PICK, m)
    assert found.success.tolist() == [True, True, True, False]
    # 80 / 160 = 0.5; 80 / 80 = 1; faster than the oracle's upper bound is 1; no success is 0
    assert np.allclose(found.scores["sct"], row(0.5, 1.0, 1.0, 0.0))


def test_release_is_masked_only_while_the_target_is_held():
    m = measures(3, holding_target=row(True, False, False), holding_other=row(False, True, False))
    for gripper in (-1.0, 0.7):
        masked = PICK.mask_gripper(torch.full((3,), gripper), m)
        assert masked[0] >= 0
        assert masked[1:].tolist() == pytest.approx([gripper, gripper])
