"""Reset of one row of a batch, for every skill, without a simulator."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from builders import snapshot
from rules_harness import FIRST, RulesHarness

from hab_tasks.envs import ENVS

N, STEPS = 3, 12
SKILLS = [e for e in ENVS if hasattr(ENVS[e].env, "skill")]


def chance(requirements, seed):
    """Things wander about, are held and let go, doors move, the robot bumps."""
    draw = torch.Generator().manual_seed(seed)
    objects, articulations = requirements.objects, len(requirements.articulations)

    def near(*shape):
        return 0.2 * torch.randn(N, *shape, generator=draw)

    return snapshot(
        N,
        objects=objects,
        articulations=articulations,
        ee_m=near(3),
        base=near(3),
        objects_m=near(objects, 3),
        handles_m=near(articulations, 3),
        joints=near(articulations).abs() * 6,
        held=torch.randint(FIRST - 1, FIRST + objects + 1, (N,), generator=draw),
        held_handle=torch.randint(-1, 2, (N,), generator=draw),
        force_n=torch.full((N,), 1e4),
    )


@pytest.mark.parametrize("env_id", SKILLS)
def test_a_row_that_starts_anew_neither_pays_nor_fails_for_its_past(env_id):
    env = ENVS[env_id].env
    harness = RulesHarness(env, N)
    # Ahead of the fridge's door, so that the base is inside its region.
    frame = np.tile(np.float32((-1.2, 0.0, 0.0)), (N, len(env.requirements.articulations), 1))
    harness.tracker.goals = replace(harness.world.goals, articulation_frame=frame)
    harness.begin(chance(env.requirements, 0))
    for seed in range(1, STEPS):
        harness.step(chance(env.requirements, seed), np.ones(N, dtype=bool))
    tracker = harness.tracker
    before = tracker.get_state()
    far = torch.full((N, 3), 5.0)
    harness.world.snapshot = harness.snapshot(base=torch.zeros(N, 3), ee_m=far, ee_in_base_m=far)
    tracker.begin(harness.world.snapshot, [1])
    found = harness.env.evaluate()
    assert not found["success"][1] | found["fail"][1]
    assert {name: float(t[1]) for name, t in found["reward_terms"].items() if t[1]} == {}
    after = tracker.get_state()
    assert after["steps"].tolist() == [STEPS - 1.0, 0.0, STEPS - 1.0]
    assert all(np.array_equal(after[name][[0, 2]], before[name][[0, 2]]) for name in before)
    # Its past would have ended it, where anything does.
    if "force" in found["failures"]:
        assert found["failures"]["force"].tolist() == [True, False, True]
