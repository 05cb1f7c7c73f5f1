"""Reset of one row of a batch, for every environment, on tensors without a simulator."""

from dataclasses import replace

import pytest
import torch
from builders import StraightWays, evaluate_rules, snapshot

from hab_tasks.articulations import FRIDGE
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Tracker
from hab_tasks.envs import ENVS

N, STEPS = 3, 12
ROWS, FRESH = torch.arange(N), torch.tensor([1])
OTHERS = [0, 2]

SKILLS = [e for e in ENVS if hasattr(ENVS[e].env, "skill")]


def snapshots(requirements, seed=0):
    """Random snapshots: things wander about, are held and let go, doors move, the robot bumps."""
    draw = torch.Generator().manual_seed(seed)

    def near(*shape):
        return 0.2 * torch.randn(*shape, generator=draw)

    def chosen(count):
        return torch.randint(-1, count, (N,), generator=draw)

    return [
        snapshot(
            N,
            objects=requirements.objects,
            articulations=len(requirements.articulations),
            ee_m=near(N, 3),
            base=near(N, 3),
            objects_m=near(N, requirements.objects, 3),
            handles_m=near(N, len(requirements.articulations), 3),
            joints=near(N, len(requirements.articulations)).abs() * 6,
            held=chosen(requirements.objects + 1),
            held_handle=chosen(2),
            force_n=1000 * near(N).clamp(min=0.0),
        )
        for _ in range(STEPS)
    ]


def tracker_of(requirements):
    goals = Goals.empty(N, requirements.objects, len(requirements.articulations), "cpu")
    if FRIDGE in requirements.articulations:
        # Ahead of the door, so that the base is inside its region.
        frame = torch.tensor([-1.2, 0.0, 0.0]).expand(N, len(requirements.articulations), 3)
        goals = replace(goals, articulation_frame=frame.clone())
    tracker = Tracker(goals, StraightWays() if requirements.navigates else None)
    for number in range(requirements.objects):
        tracker.targets[:, number] = number
    return tracker


@pytest.mark.parametrize("env_id", SKILLS)
def test_a_row_that_starts_anew_neither_pays_nor_fails_for_its_past(env_id):
    skill = ENVS[env_id].env.skill
    tracker = tracker_of(skill.requirements)
    first, *others, fresh = snapshots(skill.requirements)
    tracker.begin(first, ROWS)
    for shot in others:
        tracker.advance(replace(shot, force_n=torch.full((N,), 1e4)), ROWS > 0)
    before = tracker.get_state()
    fresh = replace(
        fresh,
        base=torch.zeros(N, 3),
        ee_m=torch.full((N, 3), 5.0),
        ee_in_base_m=torch.full((N, 3), 5.0),
        held=torch.full((N,), -1),
        held_handle=torch.full((N,), -1),
        force_n=torch.zeros(N),
    )
    tracker.begin(fresh, FRESH)
    evaluated = evaluate_rules(skill, tracker.measures, fresh, tracker.goals)
    assert not any(failed[1] for failed in evaluated.failures.values())
    assert not evaluated.success[1]
    assert {name: float(t[1]) for name, t in evaluated.terms.items() if t[1]} == {}
    after = tracker.get_state()
    assert after["steps"].tolist() == [STEPS - 2.0, 0.0, STEPS - 2.0]
    assert all(torch.equal(after[name][OTHERS], before[name][OTHERS]) for name in before)
    # Its past would have ended it, where anything does.
    if "force" in evaluated.failures:
        assert evaluated.failures["force"].tolist() == [True, False, True]
