"""All endings of Pick in the simulator, and the effects of holding an object."""

import numpy as np
import pytest
import torch
from builders import ee_action, first_episode, go_above_and_grasp, reach, starts_on
from playing import ee_grip, held, put


def start(make, index=0, **options):
    env = make(control_mode="ee", **options)
    env.reset(options={"episode": index})
    return env, env.unwrapped.episode[0]


def move(env, *direction, gripper=-1.0):
    return env.step(ee_action(env, direction, gripper))


def hand_of(state):
    """The end-effector (3,) and its axes (3, 3), 8 cm ahead of the gripper's link."""
    link = state.world_from_body["hab_fetch/gripper_link"]
    return link[:3, 3] + 0.08 * link[:3, 0], link[:3, :3]


def test_success_is_the_target_in_the_hand_at_rest(make):
    env, episode = start(make)
    put(env, episode.target, (0.05, 0.0, -0.1))
    _, reward, terminated, _, info = env.step(ee_grip(env))
    # The hand starts within 0.09 m of its resting position: 0.05 m of noise on each axis.
    assert info["success"]
    assert terminated
    assert not info["fail"]
    assert held(env) == episode.target
    terms = {name: float(value) for name, value in info["reward_terms"].items()}
    assert (terms["success"], terms["pickup"], terms["approach"]) == (20.0, 5.0, 0.0)
    assert float(reward) == pytest.approx(25.0 + terms["retract"] + terms["force"])


def test_the_wrong_object_ends_the_episode(make):
    env, episode = start(make, first_episode(make(), lambda e: len(e.objects) > 1))
    other = next(n for n in sorted(episode.objects) if n != episode.target)
    put(env, other, (0.0, 0.0, -0.1))
    _, _, terminated, _, info = env.step(ee_grip(env))
    assert held(env) == other
    assert terminated
    assert info["failures"]["wrong_object"]
    assert float(info["reward_terms"]["wrong_object"]) == -5.0
    assert not info["success"]


def test_pressing_on_the_furniture_exceeds_the_force(make):
    table = first_episode(make(), lambda e: starts_on(e, "Tbl", "Sofa", "counter"))
    env, episode = start(make, table)
    below = env.unwrapped.privileged()[0].object_com_m[episode.target] - [0, 0, 0.6]
    results = reach(env, below, -1.0, steps=200, within_m=0.0)
    info = results[-1][-1]
    assert info["failures"]["force"], float(info["measures"]["force_total_n"])
    assert results[-1][2]
    assert float(info["measures"]["force_total_n"]) > 5000.0
    assert float(info["reward_terms"]["force_exceeded"]) == -10.0
    totals = torch.cat([r[-1]["measures"]["force_total_n"] for r in results])
    forces = torch.cat([r[-1]["measures"]["force_n"] for r in results])
    assert torch.allclose(totals, forces.cumsum(0), rtol=1e-4)
    penalties = torch.cat([r[-1]["reward_terms"]["force"] for r in results])
    assert torch.allclose(penalties, -(0.001 * forces).clamp(max=1.0))


def test_privileged_state_is_the_simulators(make):
    env, episode = start(make)
    put(env, episode.target, (0.0, 0.0, -0.14))
    env.step(ee_grip(env))
    base = env.unwrapped
    (state,) = base.privileged()
    bodies = base.simulation.scene_bodies
    assert state.targets == (state.held,) == (episode.target,)
    assert set(state.object_com_m) == set(bodies.pickables) == set(episode.objects)
    links = {f"hab_fetch/{link.name}": link for link in base.agent.robot.links}
    for name, body in {**bodies.pickables, **links}.items():
        matrix = body.pose.to_transformation_matrix()[0].numpy()
        assert np.allclose(state.world_from_body[name], matrix, atol=1e-5), name
    loose = {body.name for body in state.bodies if body.group == "object"}
    assert loose == set(episode.objects) | set(bodies.loose)
    qpos = base.agent.robot.get_qpos()[0].numpy()
    assert np.allclose(state.arm_qpos, qpos[base.agent.arm_index.tolist()])
    assert len(state.locked_qpos) == len(qpos) - 7
    assert {b.name for b in state.bodies} >= set(state.world_from_body)
    assert base.privileged()[0].bodies is state.bodies


@pytest.mark.parametrize("frame", ["base", "ee"])
def test_the_objects_start_and_the_hands_orientation_are_observed(make, frame):
    """The observation goes on pointing at the start when the object is in the hand."""
    env, episode = start(make, 1, obs_mode="state_dict", target_frame=frame)
    begin = env.unwrapped.privileged()[0].object_com_m[episode.target]
    go_above_and_grasp(env, episode.target)
    for _ in range(3):
        obs = move(env, 0.3, 0, 1, gripper=1.0)[0]
    (state,) = env.unwrapped.privileged()
    ee, axes = hand_of(state)
    base_from_ee = state.world_from_base[:3, :3].T @ axes
    six = np.concatenate((base_from_ee[:, 0], base_from_ee[:, 1]))
    assert np.allclose(obs["agent"]["ee_rotation"][0], six, atol=1e-4)
    name = "object_start_in_ee"
    if frame == "base":
        axes, name = state.world_from_base[:3, :3], "object_start_from_ee"
    assert list(obs["extra"]) == [name]
    assert np.allclose(obs["extra"][name][0], axes.T @ (begin - ee), atol=1e-4)


def test_ee_actions_move_the_hand_along_the_axes_of_what_is_told(make):
    """Steps to the left shorten the second entry of the way by 1.5 cm each."""
    env, _ = start(make, 1, obs_mode="state_dict")
    before = move(env, 0, 0, 0)[0]["extra"]["object_start_from_ee"]
    for left in [1] * 6 + [0] * 20:
        obs, *_, info = move(env, 0, left, 0)
        assert float(info["measures"]["force_n"]) == 0.0
    # 6 steps of 0.015 m are 0.09 m to the left; the drives leave a millimetre or two.
    moved = (before - obs["extra"]["object_start_from_ee"])[0]
    assert np.allclose(moved, [0.0, 0.09, 0.0], atol=0.005)
