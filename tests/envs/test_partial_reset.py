"""Reset of one row of a batch, for every environment, on tensors without a simulator."""

from dataclasses import fields, replace

import pytest
import torch
from builders import StraightWays, evaluate_rules, snapshot

from hab_tasks.articulations import FRIDGE
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Tracker
from hab_tasks.envs import ENVS
from hab_tasks.tasks.progress import Progress

N, STEPS = 3, 12
ROWS, FRESH = torch.arange(N), torch.tensor([1])
OTHERS = [0, 2]

SKILLS = [e for e in ENVS if hasattr(ENVS[e].env, "skill")]
TASKS = [e for e in ENVS if hasattr(ENVS[e].env, "task")]


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


def alone(shot, row):
    """A batch of which every row is one and the same."""
    values = {f.name: getattr(shot, f.name)[[row] * N] for f in fields(shot)}
    return replace(shot, **values)


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


@pytest.mark.parametrize("env_id", SKILLS)
def test_rows_of_a_skill_do_not_influence_each_other(env_id):
    skill = ENVS[env_id].env.skill
    shots = snapshots(skill.requirements, seed=1)

    def play(shots):
        tracker, found = tracker_of(skill.requirements), []
        tracker.begin(shots[0], ROWS)
        for step, shot in enumerate(shots[1:]):
            if step == STEPS // 2:
                tracker.begin(shot, FRESH)
            tracker.advance(shot, ROWS >= 0)
            found.append(evaluate_rules(skill, tracker.measures, shot, tracker.goals))
        return found

    whole = play(shots)
    assert len({round(float(j.reward[0]), 4) for j in whole}) > 3
    # Row 1 starts anew in the middle in both; the others are compared where they did not.
    single = play([alone(shot, 1) for shot in shots])
    for ours, others in zip(single, whole, strict=True):
        assert torch.allclose(ours.reward[1], others.reward[1])
        assert all(ours.failures[n][1] == others.failures[n][1] for n in ours.failures)
    for row in OTHERS:
        single = play([alone(shot, row) for shot in shots])
        for ours, others in zip(single, whole, strict=True):
            assert torch.allclose(ours.reward[row], others.reward[row])
            assert ours.success[row] == others.success[row]


@pytest.mark.parametrize("env_id", TASKS)
def test_rows_of_a_task_do_not_influence_each_other(env_id):
    env = ENVS[env_id].env
    shots = snapshots(env.requirements, seed=2)

    def play(shots):
        tracker, progress = tracker_of(env.requirements), Progress(env.task, ROWS)
        tracker.begin(shots[0], ROWS)
        progress.begin(ROWS, shots[0], tracker.goals, tracker.targets)
        for step, shot in enumerate(shots[1:]):
            if step == STEPS // 2:
                tracker.begin(shot, FRESH)
                progress.begin(FRESH, shot, tracker.goals, tracker.targets)
                tracker.refocus(shot, FRESH, progress.focus)
            rows = progress.move_on()
            tracker.refocus(shot, rows, progress.focus)
            tracker.advance(shot, ROWS >= 0)
            progress.advance(shot, tracker.measures, tracker.goals, tracker.targets)
        return progress.get_state() | tracker.get_state()

    whole = play(shots)
    assert len(set(whole["part"].tolist()) | set(whole["stages"].tolist())) > 1
    for row in range(N):
        single = play([alone(shot, row) for shot in shots])
        for name, value in whole.items():
            assert torch.allclose(single[name][row], value[row]), name
