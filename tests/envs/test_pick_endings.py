"""All endings of Pick in the simulator, and the effects of holding an object."""

import numpy as np
import pytest
import torch
from builders import first_episode, go_above_and_grasp, reach, starts_on
from playing import held, put

from hab_tasks.constants import GRASP_RADIUS_M

STILL = np.zeros(4, dtype=np.float32)
DOWN = np.array([0, 0, -1, -1], dtype=np.float32)


def start(make, index=0, **options):
    env = make(control_mode="ee", **options)
    env.reset(options={"episode": index})
    return env, env.unwrapped.episode[0]


def grip(value=1.0):
    return np.array([0, 0, 0, value], dtype=np.float32)


def test_success_is_the_target_in_the_hand_at_rest(make):
    env, episode = start(make)
    put(env, episode.target, (0.05, 0.0, -0.1))
    _, reward, terminated, _, info = env.step(grip())
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
    _, _, terminated, _, info = env.step(grip())
    assert held(env) == other
    assert terminated
    assert info["failures"]["wrong_object"]
    assert float(info["reward_terms"]["wrong_object"]) == -5.0
    assert not info["success"]


@pytest.mark.parametrize(("distance", "grasped"), [(0.149, True), (0.151, False)])
def test_the_grasp_reaches_15_cm(make, distance, grasped):
    env, episode = start(make)
    put(env, episode.target, (0.0, 0.0, -distance))
    env.step(grip())
    assert (held(env) == episode.target) == grasped
    assert GRASP_RADIUS_M == 0.15


def test_release_is_masked_while_the_target_is_held(make):
    env, episode = start(make)
    put(env, episode.target, (0.0, 0.0, -0.14))
    env.step(grip())
    for _ in range(5):
        info = env.step(grip(-1.0))[-1]
        assert held(env) == episode.target
        assert not info["failures"]["dropped_object"]


@pytest.mark.new_env
def test_the_target_torn_out_of_the_hand_is_dropped(make):
    env, episode = start(make)
    put(env, episode.target, (0.0, 0.0, -0.14))
    env.step(grip())
    world = env.unwrapped._simulation
    index = world._names.index(episode.target)
    body = world._grasp.objects[index]._bodies[0]
    pose = body.entity_pose
    pose.p = np.add(pose.p, (0.0, 0.0, -0.5))  # more than the drive can bring back in one action
    world._grasp._untie(0)
    world._grasp._tie_object = lambda row, index: None
    body.entity.pose = pose
    world._grasp._ties[0] = _fresh_tie(world)
    _, _, terminated, _, info = env.step(grip())
    assert held(env) is None
    assert info["failures"]["dropped_object"]
    assert terminated
    assert float(info["reward_terms"]["dropped_object"]) == -5.0
    # The hand is empty: the way to the object pays again, the way to rest does not.
    assert float(info["reward_terms"]["retract"]) == 0.0


def _fresh_tie(world):
    """A drive without limits between hand and nothing, in place of the one that was cut."""
    import sapien

    gripper = world._grasp.ee_link._objs[0].entity
    drive = world._scene.sub_scenes[0].create_drive(None, sapien.Pose(), gripper, sapien.Pose())
    return drive.entity, drive


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


def test_no_force_without_contact(make):
    env, _ = start(make)
    for _ in range(10):
        info = env.step(grip(-1.0))[-1]
        assert float(info["measures"]["force_n"]) == 0.0


def test_privileged_state_is_the_simulators(make):
    env, episode = start(make)
    put(env, episode.target, (0.0, 0.0, -0.14))
    env.step(grip())
    base = env.unwrapped
    (state,) = base.privileged()
    assert state.targets == (state.held,) == (episode.target,)
    assert set(state.object_com_m) == set(episode.objects)
    actors = base._simulation.scene_bodies.pickables
    assert set(actors) == set(episode.objects)
    for name in episode.objects:
        matrix = actors[name].pose.to_transformation_matrix()[0].numpy()
        assert np.allclose(state.world_from_body[name], matrix, atol=1e-5)
    loose = {body.name for body in state.bodies if body.group == "object"}
    assert loose == set(episode.objects) | set(base._simulation.scene_bodies.loose)
    qpos = base.agent.robot.get_qpos()[0].numpy()
    assert np.allclose(state.arm_qpos, qpos[base.agent.arm_index.tolist()])
    assert len(state.locked_qpos) == len(qpos) - 7
    links = {link.name: link for link in base.agent.robot.links}
    for name, link in links.items():
        matrix = link.pose.to_transformation_matrix()[0].numpy()
        assert np.allclose(state.world_from_body[f"hab_fetch/{name}"], matrix, atol=1e-5)
    assert {b.name for b in state.bodies} >= set(state.world_from_body)
    again = base.privileged()[0]
    assert again.scene_key == state.scene_key
    assert again.bodies is state.bodies


def test_measures_agree_with_the_privileged_state(make):
    env, episode = start(make, 1)
    for _ in range(5):
        env.step(np.array([0.5, 0.3, -0.6, -1], dtype=np.float32))
        (state,) = env.unwrapped.privileged()
        link = state.world_from_body["hab_fetch/gripper_link"]
        ee = link[:3, 3] + 0.08 * link[:3, 0]
        gap = np.linalg.norm(ee - state.object_com_m[episode.target])
        m = env.unwrapped.measures
        assert float(m.ee_to_object_m[0]) == pytest.approx(gap, abs=1e-5)
        in_base = np.linalg.inv(state.world_from_base) @ np.append(ee, 1.0)
        # The base frame's origin lies BASE_HEIGHT_M above the floor that heights are measured from.
        assert np.allclose(m.ee_in_base_m[0, :2], in_base[:2], atol=1e-5)


@pytest.mark.parametrize("frame", ["base", "ee"])
def test_the_observation_keeps_pointing_at_the_objects_start(make, frame):
    env, episode = start(make, 1, obs_mode="state_dict", target_frame=frame)
    begin = env.unwrapped.privileged()[0].object_com_m[episode.target]
    go_above_and_grasp(env, episode.target)
    for _ in range(3):
        obs = env.step(np.array([0, 0, 1, 1], dtype=np.float32))[0]
    (state,) = env.unwrapped.privileged()
    link = state.world_from_body["hab_fetch/gripper_link"]
    ee = link[:3, 3] + 0.08 * link[:3, 0]
    axes, name = link[:3, :3], "object_start_in_ee"
    if frame == "base":
        axes, name = state.world_from_base[:3, :3], "object_start_from_ee"
    assert list(obs["extra"]) == [name]
    assert np.allclose(obs["extra"][name][0], axes.T @ (begin - ee), atol=1e-4)


def test_the_hands_orientation_is_observed(make):
    env, episode = start(make, 1, obs_mode="state_dict")
    go_above_and_grasp(env, episode.target)
    obs = env.step(np.array([1, 0, 0, 1], dtype=np.float32))[0]
    (state,) = env.unwrapped.privileged()
    link = state.world_from_body["hab_fetch/gripper_link"]
    base_from_ee = state.world_from_base[:3, :3].T @ link[:3, :3]
    six = np.concatenate((base_from_ee[:, 0], base_from_ee[:, 1]))
    assert np.allclose(obs["agent"]["ee_rotation"][0], six, atol=1e-4)


def test_ee_actions_move_the_hand_along_the_axes_of_what_is_told(make):
    """Steps to the left shorten the second entry of the way by 1.5 cm each."""
    env, _ = start(make, 1, obs_mode="state_dict")
    before = env.step(np.array([0, 0, 0, -1], dtype=np.float32))[0]["extra"]["object_start_from_ee"]
    for _ in range(6):
        env.step(np.array([0, 1, 0, -1], dtype=np.float32))
    for _ in range(20):
        obs = env.step(np.array([0, 0, 0, -1], dtype=np.float32))[0]
    # 6 steps of 0.015 m are 0.09 m to the left; the drives leave a millimetre or two.
    moved = (before - obs["extra"]["object_start_from_ee"])[0]
    assert np.allclose(moved, [0.0, 0.09, 0.0], atol=0.005)
