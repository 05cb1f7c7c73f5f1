"""Stages, success and enclosed objects of the three tasks, in the simulator."""

import numpy as np
import pytest
import torch
from hab_plans import plan_of, problem_of
from hab_plans.belief import believed, observed, start_from
from hab_plans.problem import atoms_of
from hab_plans.solve import solve
from hab_spa.scenes.true_scene import TrueScene
from playing import ee_grip, held, move_base, move_joint, put, slow, still

from hab_tasks.constants import REST_STEPS
from hab_tasks.envs import ENVS
from hab_tasks.robots.fetch import FETCH

TASKS = [e for e in ENVS if hasattr(ENVS[e].env, "task")]


def start(make, env_id, index=0):
    env = make(env_id, control_mode="ee_base")
    env.reset(options={"episode": index})
    return env


def let_go(env):
    if held(env) is not None:
        env.step(ee_grip(env, -1.0))


def take(env, name):
    """Puts an object below the hand, and grasps it."""
    let_go(env)
    put(env, name, (0.0, 0.0, -0.14))
    return env.step(ee_grip(env))


def bring(env, number):
    """Lets go, puts an object where it is to be, and waits until it counts as at rest."""
    let_go(env)
    base = env.unwrapped
    target = base.episode[0].targets[number]
    state = base.get_state_dict()
    actor = base.simulation.scene_bodies.pickables[target.object]
    state["actors"][actor.name][0, :7] = torch.tensor(target.world_from_goal)
    state["actors"][actor.name][0, 7:] = 0.0
    base.set_state_dict(state)
    for _ in range(REST_STEPS + 1):
        step = env.step(still(env))
        if step[2]:
            break
    return step


def slide(env, number, share):
    """Puts a door or drawer at a share of its travel."""
    base = env.unwrapped
    goals = base.simulation.goals
    lower, upper = float(goals.joint_lower[0, number]), float(goals.joint_upper[0, number])
    state = base.get_state_dict()
    move_joint(state, env, number, lower + share * (upper - lower))
    base.set_state_dict(state)
    return env.step(still(env))


def satisfy(env, condition, before):
    """Does what a stage asks for beyond the one before it; returns the last step."""
    step = None
    for number in condition.opened:
        step = slide(env, number, 1.0)
    for number in set(condition.closed) - set(before.closed):
        step = slide(env, number, 0.0)
    for number in condition.held:
        step = take(env, env.unwrapped.episode[0].targets[number].object)
    for number in set(condition.placed) - set(before.placed):
        step = bring(env, number)
    return step


def stages(step):
    return [name for name, reached in step[-1]["stages"].items() if bool(reached)]


@pytest.mark.parametrize("env_id", TASKS)
def test_stages_latch_in_their_order_and_the_last_is_success(make, env_id):
    env = start(make, env_id)
    task = env.unwrapped.task
    names, before = list(task.stages), type(task.goal)()
    for number, (name, condition) in enumerate(task.stages.items()):
        step = satisfy(env, condition, before)
        assert stages(step) == names[: number + 1], name
        last = number == len(names) - 1
        assert bool(step[-1]["success"]) == bool(step[2]) == last
        before = condition


@pytest.mark.parametrize("env_id", ["HabTidyHouse-v1", "HabPrepareGroceries-v1"])
def test_a_stage_cannot_be_skipped_and_is_not_taken_back(make, env_id):
    env = start(make, env_id)
    first, second, *_ = env.unwrapped.task.stages
    name = env.unwrapped.episode[0].targets[0].object
    assert stages(bring(env, 1)) == []
    assert stages(bring(env, 0)) == []
    assert stages(take(env, name)) == [first]
    assert stages(bring(env, 0)) == [first, second]
    # Away from its goal again: the stage stays, success is that of the moment.
    assert stages(take(env, name)) == [first, second]


def test_nothing_ends_a_task_but_all_objects_in_place_without_any_stage(make):
    """Success is a matter of geometry; no force, no wrong and no dropped object ends it (S G.1)."""
    env = start(make, "HabTidyHouse-v1")
    base = env.unwrapped
    (episode,) = base.episode
    other = min({*episode.objects} - {target.object for target in episode.targets})
    step = take(env, other)
    assert held(env) == other
    assert not step[2]
    state = base.get_state_dict()
    state["hab"]["tracker"]["force_total_n"][:] = 1e6
    base.set_state_dict(state)
    step = env.step(ee_grip(env, -1.0))
    assert not step[2]
    assert not step[-1]["fail"]
    for number in range(5):
        step = bring(env, number)
        assert bool(step[-1]["success"]) == bool(step[2]) == (number == 4)
    assert stages(step) == []


@slow
@pytest.mark.parametrize("env_id", TASKS)
def test_predicates_follow_the_stages_and_planning_goes_on_from_them(make, env_id):
    env = start(make, env_id)
    base, problem = env.unwrapped, problem_of(env_id)
    task, before, planned = base.task, type(base.task.goal)(), len(plan_of(env_id).actions)
    assert start_from(base) == problem.start
    for number, (name, condition) in enumerate(task.stages.items()):
        satisfy(env, condition, before)
        assert atoms_of(task.spec, condition) <= observed(base), name
        # What a planner believes that sees the true state is what success asks.
        scene = TrueScene(FETCH)
        scene.see({"privileged": base.privileged()}, 0)
        assert believed(task, scene) == observed(base), name
        # Each stage takes two actions, to drive there and to do it.
        left = planned - 2 * (number + 1)
        assert len(solve(problem.started(start_from(base))).actions) == left, name
        before = condition


@pytest.mark.parametrize("number", [0, 1], ids=["bowl", "apple"])
def test_what_is_shut_in_cannot_be_grasped(make, number):
    """The bowl in the closed drawer and the apple in the closed fridge, and open ones can be."""
    for open_share in (0.0, 0.9):
        env = start(make, "HabSetTable-v1")
        base, world = env.unwrapped, env.unwrapped.simulation
        name = base.episode[0].targets[number].object
        # The hand goes to the object through whatever is between, and grasps without physics.
        gap = base.privileged()[0].object_com_m[name] - np.asarray(world.snapshot.ee_m)[0]
        x, y, yaw = np.asarray(world.snapshot.base)[0]
        state = base.get_state_dict()
        move_base(state, env, x + gap[0], y + gap[1], yaw)
        state["articulations"][base.agent.robot.name][0, 2] += float(gap[2])
        move_joint(state, env, number, open_share * float(world.goals.joint_upper[0, number]))
        base.set_state_dict(state)
        ee = np.asarray(world.snapshot.ee_m)[0]
        assert np.allclose(ee, base.privileged()[0].object_com_m[name], atol=1e-3)
        world.grasp.command(1.0)
        assert held(env) == (name if open_share else None)
