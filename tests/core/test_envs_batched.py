"""Rewards, scores and observations of all environments on random batches, without a simulator."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from builders import same, snapshot
from rules_harness import FIRST, RulesHarness

from hab_tasks.constants import REST_POSITION_M, REST_STEPS
from hab_tasks.engine.skill_env import SkillEnv
from hab_tasks.envs import ENVS
from hab_tasks.tasks.task_env import TaskEnv

N, STEPS, SOME = 32, 40, 2
STOPPED = np.arange(N) % 2 == 0
SKILLS = {e.id: e.env for e in ENVS.values() if issubclass(e.env, SkillEnv)}
TASKS = {e.id: e.env for e in ENVS.values() if issubclass(e.env, TaskEnv)}


def chaos(requirements, seed):
    """A snapshot in which anything may be anywhere."""
    rng = torch.Generator().manual_seed(seed)
    articulations, objects = len(requirements.articulations), requirements.objects

    def some(*shape):
        return torch.randn(N, *shape, generator=rng) * 0.3

    held = torch.randint(FIRST - 1, FIRST + objects + 1, (N,), generator=rng)
    held[torch.rand(N, generator=rng) < 0.5] = -1
    joints = 3 * torch.rand(N, articulations, generator=rng)
    joints[torch.rand(N, articulations, generator=rng) < 0.3] = 0.0
    return snapshot(
        N,
        objects=objects,
        articulations=articulations,
        arm_qpos_rad=some(7),
        base=some(3),
        ee_m=some(3),
        ee_in_base_m=torch.tensor(REST_POSITION_M) + some(3) / 3,
        objects_m=some(objects, 3),
        handles_m=some(articulations, 3),
        joints=joints,
        held=held,
        held_handle=torch.randint(-1, 2, (N,), generator=rng),
        force_n=1000 * torch.rand(N, generator=rng) ** 4,
    )


def harness_of(env, count=N):
    harness = RulesHarness(env, count)
    # So that some bases are before the fridge, and some objects at their goals.
    frames = torch.tensor([-1.4, 0.0, 0.0]).expand(count, len(env.requirements.articulations), 3)
    values = {
        "articulation_frame": frames,
        "goals_m": torch.zeros(count, env.requirements.objects, 3),
    }
    harness.tracker.goals = harness.world.goals.changed(range(count), values)
    return harness


def assert_told(env, info):
    """Every term a float32 row without NaN; their sum the reward; never above 1 when normalised."""
    terms = info["reward_terms"]
    for name, value in (*terms.items(), *info["measures"].items()):
        assert value.shape == (N,), name
        assert value.dtype == torch.float32 or name not in terms, name
        assert bool(torch.isfinite(value.float()).all()), name
    dense = env.compute_dense_reward(None, None, info)
    assert dense.dtype == torch.float32
    assert np.allclose(dense.double(), sum(term.double() for term in terms.values()), atol=1e-4)
    normalised = env.compute_normalized_dense_reward(None, None, info)
    assert bool((normalised <= 1.0).all())
    below = dense <= env.reward_bound
    assert np.allclose(normalised[below], dense[below] / env.reward_bound)
    assert not bool((info["success"] & info["fail"]).any())
    for flags in (info["failures"], info.get("stages", {})):
        assert all(flag.shape == (N,) and flag.dtype == torch.bool for flag in flags.values())


@pytest.mark.parametrize("env", SKILLS.values(), ids=SKILLS)
def test_every_reward_of_a_skill(env):
    harness, paid = harness_of(env), set()
    harness.begin(chaos(env.requirements, 0))
    # An object is placed when it has not moved for ten steps.
    still = np.repeat(np.arange(STEPS, STEPS + 10), REST_STEPS + 2).tolist()
    for number, step in enumerate((*range(1, STEPS), *still)):
        if number >= STEPS and step != still[number - STEPS]:
            harness.begin(chaos(env.requirements, number))
        info = harness.step(chaos(env.requirements, step), STOPPED)
        assert_told(harness.env, info)
        paid |= {name for name, term in info["reward_terms"].items() if term.any()}
        for name in {"sct", "spl"} & set(info["measures"]):
            score = info["measures"][name]
            assert bool(((score >= 0) & (score <= 1)).all()), name
    assert paid == set(info["reward_terms"]), f"never paid in {STEPS} steps"


@pytest.mark.parametrize("env", TASKS.values(), ids=TASKS)
def test_every_reward_of_a_task(env):
    harness, rng, paid = harness_of(env), np.random.default_rng(0), set()
    for episode in range(3):
        parts = rng.integers(len(env.task.parts), size=N).tolist()
        harness.begin(chaos(env.requirements, 1000 * episode), *parts)
        for step in range(1, STEPS // 2):
            info = harness.step(chaos(env.requirements, 1000 * episode + step))
            assert_told(harness.env, info)
            paid |= {name for name, term in info["reward_terms"].items() if term.any()}
            assert list(info["stages"]) == list(env.task.stages)
    assert {name.split("/")[0] for name in paid} == {part.skill.name for part in env.task.parts}
    # A task has no limit on force, and no region that must not be left.
    never = {n for n in info["reward_terms"] if n.endswith(("force_exceeded", "left_region"))}
    assert not paid & never


@pytest.mark.parametrize("env", [entry.env for entry in ENVS.values()], ids=ENVS)
def test_a_row_alone_is_told_what_it_is_told_in_a_batch(env):
    batch, parts = harness_of(env), []
    if issubclass(env, TaskEnv):
        parts = np.random.default_rng(1).integers(len(env.task.parts), size=N).tolist()
    batch.begin(chaos(env.requirements, 0), *parts)
    singles = [harness_of(env, 1) for _ in range(SOME)]
    for row, single in enumerate(singles):
        single.begin(only(chaos(env.requirements, 0), row), *parts[row : row + 1])
    for step in range(1, STEPS):
        told = batch.step(chaos(env.requirements, step), STOPPED)
        for row, single in enumerate(singles):
            alone = single.step(only(chaos(env.requirements, step), row), STOPPED[row : row + 1])
            assert same(alone, row_of(told, row), 1e-3), (row, step)


def only(shot, row):
    return replace(shot, **{f.name: getattr(shot, f.name)[row : row + 1] for f in fields(shot)})


def row_of(info, row):
    if isinstance(info, dict):
        return {name: row_of(value, row) for name, value in info.items()}
    return info[row : row + 1]


def test_every_observation_of_a_batch():
    for env in (entry.env for entry in ENVS.values()):
        harness = harness_of(env)
        harness.begin(chaos(env.requirements, 1))
        world = harness.world
        for item in env.observation:
            told = f"{env.__name__} {item.name}"
            value = item.read(world.snapshot, world.measures, world.goals)
            assert value.shape == (N, *item.shape), told
            assert value.dtype == np.float32, told
            assert np.isfinite(value).all(), told
            assert len(np.unique(value, axis=0)) > 1, f"{told} is the same in every row"
