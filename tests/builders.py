"""Small datasets, scenes and measures for tests."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import sapien
import torch
import trimesh
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor
from mani_skill.utils.structs.types import SimConfig

from hab_tasks.arrays import Floats, norm
from hab_tasks.constants import REST_POSITION_M
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import MEANINGS, Measures
from hab_tasks.engine.skill_env import Skill
from hab_tasks.engine.snapshot import Snapshot, world_to_base
from hab_tasks.episodes import Episode
from hab_tasks.robots.fetch.agent import HabFetch
from hab_tasks.simulator import parse_sim_and_render_backend
from hab_tasks.world.scenes.physics import MOVING, set_groups

TABLE_SIZE_M = (1.0, 0.8, 0.6)
"""The tiny dataset's table: x, y (up) and z extents; its origin is its middle."""

DRAWER_URDF = """<robot name="chest">
  <link name="body">
    <visual><geometry><mesh filename="body.glb" scale="1, 1, 1"/></geometry></visual>
    <collision><geometry><box size="0.4 0.3, 0.2"/></geometry></collision>
    <inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <link name="drawer">
    <visual><geometry><mesh filename="body.glb" scale="1, 1, 1"/></geometry></visual>
    <collision><origin xyz="0.3, 0, 0"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
    <inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="body"/><child link="drawer"/><axis xyz="1, 0, 0"/>
    <limit lower="0" upper="0.25" effort="10" velocity="1"/>
  </joint>
</robot>
"""


def write_json(file: Path, value: object) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(value))
    return file


def box_glb(file: Path, size_m: tuple[float, float, float] = (0.1, 0.1, 0.1)) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Scene(trimesh.creation.box(size_m)).export(file, file_type="glb")
    return file


def table_config(scale: tuple[float, float, float] = (0.5, 0.1, 0.3)) -> dict:
    """A table with one receptacle on its top: half extents `scale`, 0.1 m high on each side."""
    name = "receptacle_aabb_Tbl1_Top1_frl_apartment_table_01"
    return {
        "render_asset": "../../objects/table.glb",
        "collision_asset": "../../objects/table.glb",
        "mass": 18,
        "user_defined": {name: {"name": name, "position": [0.0, 0.5, 0.0], "scale": list(scale)}},
    }


def tiny_dataset(root: Path, *, urdf_file: str = "chests/chest.urdf") -> Path:
    """Writes a dataset of one scene: a stage without a mesh, a table, a loose cube, a chest.

    Args:
        urdf_file: ``chests/chest.urdf`` as Facebook names files, ``chest/chest.urdf`` as ManiSkill.
    """
    write_json(root / "tiny.scene_dataset_config.json", {})
    write_json(
        root / "configs/stages/room.stage_config.json", {"render_asset": "../../stages/room.glb"}
    )
    write_json(root / "configs/objects/table.object_config.json", table_config())
    cube = {"render_asset": "../../objects/cube.glb", "use_bounding_box_for_collision": True}
    write_json(root / "configs/objects/cube.object_config.json", cube)
    box_glb(root / "objects/table.glb", TABLE_SIZE_M)
    box_glb(root / "objects/cube.glb", (0.1, 0.2, 0.3))
    urdf = root / "urdf" / urdf_file
    box_glb(urdf.parent / "body.glb", (0.4, 0.3, 0.2))
    urdf.write_text(DRAWER_URDF)
    write_scene(root, tiny_scene())
    return root


def tiny_scene() -> dict:
    half = math.sqrt(0.5)
    return {
        "stage_instance": {"template_name": "stages/room"},
        "object_instances": [
            {"template_name": "table", "translation": [1, 0.4, 2], "motion_type": "STATIC"},
            {
                "template_name": "objects/cube",
                "translation": [1, 0.9, 2],
                "rotation": [half, 0, half, 0],
                "motion_type": "DYNAMIC",
            },
        ],
        "articulated_object_instances": [
            {"template_name": "chest", "translation": [-1, 0.2, 0], "uniform_scale": 2.0}
        ],
    }


def write_scene(root: Path, scene: dict, scene_id: str = "v3_sc0_staging_00") -> Path:
    return write_json(root / f"configs/scenes/{scene_id}.scene_instance.json", scene)


def cpu_scene() -> ManiSkillScene:
    """An empty physics scene on the CPU, without a renderer, 120 Hz."""
    px = sapien.physx.PhysxCpuSystem()
    backend = parse_sim_and_render_backend("physx_cpu", "none")
    config = SimConfig(sim_freq=120, control_freq=30)
    scene = ManiSkillScene(
        [sapien.Scene([px])], sim_config=config, device=backend.device, backend=backend
    )
    px.timestep = 1 / 120
    return scene


def box_actor(
    scene: ManiSkillScene,
    name: str,
    half_m: tuple[float, float, float],
    position_m: tuple[float, float, float],
    *,
    density: float = 500.0,
    static: bool = False,
) -> Actor:
    """A box in the collision group of loose objects."""
    builder = scene.create_actor_builder()
    builder.initial_pose = sapien.Pose(list(position_m))
    builder.add_box_collision(half_size=list(half_m), density=density)
    actor = builder.build_static(name) if static else builder.build(name)
    set_groups(actor._bodies[0], MOVING)
    return actor


def start_fetch(agent: HabFetch) -> None:
    agent.robot.set_qpos(agent.rest_qpos()[None])
    agent.robot.set_qvel(torch.zeros(1, len(agent.joint_index)))
    agent.controller.reset()


def arrays(values: dict[str, Any]) -> dict[str, np.ndarray]:
    """Tensors, lists and arrays as arrays."""
    whole = {n: v.numpy() if isinstance(v, torch.Tensor) else v for n, v in values.items()}
    return {name: np.array(value) for name, value in whole.items()}


def snapshot(
    count: int = 1, *, objects: int = 1, articulations: int = 0, **values: Any
) -> Snapshot:
    """A snapshot of `count` rows at the origin with nothing held, except for `values`."""
    nothing = np.full(count, -1)
    raw: dict[str, Any] = {
        "arm_qpos_rad": np.zeros((count, 7), np.float32),
        "base": np.zeros((count, 3), np.float32),
        "fingers_m": np.zeros((count, 0), np.float32),
        "ee_m": np.zeros((count, 3), np.float32),
        "ee_axes": np.tile(np.eye(3, dtype=np.float32), (count, 1, 1)),
        "objects_m": np.zeros((count, objects, 3), np.float32),
        "handles_m": np.zeros((count, articulations, 3), np.float32),
        "joints": np.zeros((count, articulations), np.float32),
        "held": nothing,
        "held_handle": nothing.copy(),
        "lost": np.zeros(count, dtype=bool),
        "force_n": np.zeros(count, np.float32),
    }
    raw |= arrays(values)
    base, up = raw["base"], np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
    up[:, 0, 0] = up[:, 1, 1] = np.cos(base[:, 2])
    up[:, 1, 0], up[:, 0, 1] = np.sin(base[:, 2]), -np.sin(base[:, 2])
    known = {"base_axes": up, "ee_in_base_m": world_to_base(base, raw["ee_m"][:, None])[:, 0]}
    return Snapshot(**known | raw)


def row(*values: float) -> np.ndarray:
    """One value for each row, (N,)."""
    return np.array(values, dtype=np.float32 if isinstance(values[0], float) else None)


def goals_of(count: int, objects: int = 1, articulations: int = 0, **values: Any) -> Goals:
    """Goals of `count` rows that are zero, except for `values`."""
    rest = np.tile(np.float32(REST_POSITION_M), (count, 1))
    empty = replace(Goals.empty(count, objects, articulations), rest_m=rest)
    return replace(empty, **arrays(values))


def measures(count: int = 1, **values: Any) -> Measures:
    """Measures of `count` rows that are all zero or False, except for `values`."""
    zeros, never = np.zeros(count, np.float32), np.zeros(count, dtype=bool)
    raw = {name: never if unit == "bool" else zeros for name, (unit, _) in MEANINGS.items()}
    points = {"ee_in_base_m": np.zeros((count, 3)), "base_m": np.zeros((count, 2))}
    return Measures(**{**raw, **points, **arrays(values)})


class Evaluated(NamedTuple):
    """What a skill says of N rows."""

    success: np.ndarray
    failures: dict[str, np.ndarray]
    terms: dict[str, np.ndarray]
    reward: np.ndarray
    scores: dict[str, np.ndarray]


def evaluate_rules(
    skill: Skill, m: Measures, s: Snapshot | None = None, g: Goals | None = None
) -> Evaluated:
    """Evaluates a skill on a snapshot, as an environment does."""
    count, articulations = len(m.force_n), len(skill.requirements.articulations)
    s = s or snapshot(count, articulations=articulations)
    g = g or Goals.empty(count, 1, articulations)
    failures = skill.failures(s, m, g, skill.config)
    reached = skill.success(s, m, g, skill.config)
    success = reached & ~reduce(or_, failures.values(), reached & False)
    terms = skill.reward_terms(s, m, g, skill.config, {"success": success, **failures})
    return Evaluated(success, failures, terms, sum(terms.values()), skill.scores(m, success, 0.015))


class StraightWays:
    """Ways of the base on an empty floor: every row has to go to the origin."""

    def distance_m(self, base_m: Floats) -> Floats:
        return norm(base_m)


def same(a: object, b: object, atol: float = 0.0) -> bool:
    """Whether two nested dicts of tensors, arrays and numbers are equal to within `atol`."""
    if isinstance(a, dict):
        return (
            isinstance(b, dict) and a.keys() == b.keys() and all(same(a[k], b[k], atol) for k in a)
        )
    x, y = np.asarray(a), np.asarray(b)
    if x.dtype == bool:
        return x.shape == y.shape and bool((x == y).all())
    return x.shape == y.shape and bool(np.allclose(x, y, rtol=0.0, atol=atol, equal_nan=True))


def starts_on(episode: Episode, *words: str) -> bool:
    """Whether the target starts on a receptacle with one of these words in its name."""
    start = episode.targets[0].start
    return start is not None and any(word in start[0] for word in words)


def first_episode(env: object, accept: Callable[[Episode], bool]) -> int:
    """The index of the first of the environment's episodes that `accept` takes."""
    source = env.unwrapped.simulation.source
    return next(i for i in range(source.available) if accept(source.get(i)))


def ee_action(env: object, arm: np.ndarray, gripper: float) -> np.ndarray:
    """An action of ``ee`` or ``ee_base``, the base standing still."""
    action = np.zeros(env.unwrapped.single_action_space.shape, dtype=np.float32)
    action[:3], action[3] = arm, gripper
    return action


def reach(env: object, point_m: np.ndarray, gripper: float, *, steps: int, within_m: float) -> list:
    """Drives the end-effector (``ee``, ``ee_base``) in a straight line to a world point.

    Returns:
        The results of the steps; ends within `within_m` of the point, or with the episode.
    """
    base, results = env.unwrapped, []
    for _ in range(steps):
        shot = base.simulation.snapshot
        gap = world_to_base(shot.base, np.asarray(point_m, dtype=np.float32)[None, None])[0, 0]
        gap = gap - shot.ee_in_base_m[0]
        if np.linalg.norm(gap) < within_m:
            break
        results.append(env.step(ee_action(env, np.clip(gap / 0.015, -1, 1), gripper)))
        if results[-1][2] or results[-1][3]:
            break
    return results


def go_above_and_grasp(env: object, name: str, *, gripper: float = 1.0) -> list:
    """Moves over object `name`, then down until it snaps; gripper open on the way there."""
    base = env.unwrapped
    target = base.privileged()[0].object_com_m[name]
    above = np.add(target, (0.0, 0.0, 0.25))
    results = reach(env, above, -1.0, steps=120, within_m=0.03)
    if results and (results[-1][2] or results[-1][3]):
        return results
    for height in np.arange(0.25, 0.0, -0.01):
        point = np.add(target, (0.0, 0.0, height))
        results += reach(env, point, -1.0, steps=5, within_m=0.015)
        ee = np.asarray(base.simulation.snapshot.ee_m)[0]
        if np.linalg.norm(ee - base.privileged()[0].object_com_m[name]) < 0.13:
            break
    results.append(env.step(ee_action(env, np.zeros(3), gripper)))
    return results
