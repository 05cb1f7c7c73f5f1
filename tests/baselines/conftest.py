"""Fetch and a few boxes in a bare SAPIEN scene, read as the planners' ground truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import sapien

from hab_tasks.privileged import ArticulationState, CollisionBody, CollisionShape, PrivilegedState
from hab_tasks.robots.fetch import FETCH
from hab_tasks.world.scenes import physics

EMPTY_VERTICES = np.zeros((0, 3))
EMPTY_FACES = np.zeros((0, 3), dtype=np.int64)


def fetch_without_visuals(folder: Path) -> Path:
    """Writes Fetch's URDF (and SRDF) without visuals, which need a Vulkan device."""
    root = FETCH.urdf_tree()
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    path = folder / "fetch.urdf"
    path.write_text(ElementTree.tostring(root, encoding="unicode"))
    (folder / "fetch.srdf").write_text(ElementTree.tostring(FETCH.srdf_tree(), encoding="unicode"))
    return path


def read_shape(shape: sapien.physx.PhysxCollisionShape) -> CollisionShape:
    vertices, faces, half = EMPTY_VERTICES, EMPTY_FACES, np.zeros(3)
    if isinstance(shape, sapien.physx.PhysxCollisionShapeBox):
        kind, half = "box", np.asarray(shape.half_size, dtype=float)
    else:  # Fetch has meshes only
        kind = "convex"
        vertices = np.asarray(shape.vertices, dtype=float) * np.asarray(shape.scale)
        faces = np.asarray(shape.triangles, dtype=np.int64)
    return CollisionShape(
        kind=kind,
        body_from_shape=shape.local_pose.to_transformation_matrix().astype(float),
        half_size_m=half,
        vertices_m=vertices,
        faces=faces,
    )


@dataclass
class FetchScene:
    """A SAPIEN scene with Fetch in the rest pose at the world's origin."""

    scene: sapien.Scene
    robot: sapien.physx.PhysxArticulation
    entities: dict[str, tuple[sapien.Entity, str]]

    def set_arm(self, qpos: np.ndarray) -> None:
        """Puts the arm at `qpos` (7,) and every other joint at its locked value."""
        names = [joint.name for joint in self.robot.active_joints]
        values = dict(FETCH.locked_qpos) | dict(zip(FETCH.arm_joints, qpos, strict=True))
        self.robot.set_qpos(np.array([values.get(name, 0.0) for name in names]))

    def arm_qpos(self) -> np.ndarray:
        names = [joint.name for joint in self.robot.active_joints]
        return self.robot.get_qpos()[[names.index(name) for name in FETCH.arm_joints]].astype(float)

    def add_box(self, name: str, group: str, position_m: tuple, size_m: tuple) -> None:
        """Adds a fixed or loose (group ``object``) box by its centre and full size."""
        builder = self.scene.create_actor_builder()
        builder.add_box_collision(half_size=[x / 2 for x in size_m])
        builder.set_initial_pose(sapien.Pose(list(position_m)))
        build = builder.build if group == "object" else builder.build_static
        self.entities[name] = (build(name=name), group)

    def add_table(self, height_m: float = 0.75, near_m: float = 0.45) -> None:
        """A 0.6 m deep, 1.2 m wide table whose near edge is `near_m` ahead of the base."""
        x_m, leg_m = near_m + 0.3, height_m - 0.04
        self.add_box("table", "static", (x_m, 0.0, height_m - 0.02), (0.6, 1.2, 0.04))
        for side in (-0.55, 0.55):
            self.add_box(f"leg{side:+}", "static", (x_m, side, leg_m / 2), (0.5, 0.05, leg_m))

    def _body(self, entity: sapien.Entity) -> sapien.physx.PhysxRigidBaseComponent:
        body = entity.find_component_by_type(sapien.physx.PhysxRigidBaseComponent)
        assert body is not None
        return body

    def privileged(self, target: str, held: str | None = None) -> PrivilegedState:
        """Reads the scene as a planner may see it; the target's goal is the origin."""
        bodies, poses, com = [], {}, {}
        for link in self.robot.links:
            name = f"hab_fetch/{link.name}"
            shapes = tuple(map(read_shape, link.collision_shapes))
            bodies.append(CollisionBody(name=name, group="robot", shapes=shapes))
            poses[name] = link.entity_pose.to_transformation_matrix().astype(float)
        for name, (entity, group) in self.entities.items():
            body = self._body(entity)
            shapes = tuple(map(read_shape, body.collision_shapes))
            bodies.append(CollisionBody(name=name, group=group, shapes=shapes))  # type: ignore[arg-type]
            poses[name] = entity.pose.to_transformation_matrix().astype(float)
            if group == "object":
                com[name] = (body.entity_pose * body.cmass_local_pose).p.astype(float)
        return PrivilegedState(
            scene_key=f"test-{len(bodies)}",
            bodies=tuple(bodies),
            world_from_body=poses,
            world_from_base=poses["hab_fetch/base_link"],
            arm_qpos=self.arm_qpos(),
            locked_qpos=dict(FETCH.locked_qpos),
            held=held,
            object_com_m=com,
            targets=(target,),
            goals_m=np.zeros((1, 3)),
        )


@pytest.fixture
def make_scene(tmp_path: Path) -> Callable[[], FetchScene]:
    """Returns a maker of scenes that hold nothing but Fetch in the rest pose."""

    def make() -> FetchScene:
        # As in an environment, whatever the process did before.
        physics.use_settings(physics.sim_config())
        scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
        loader = scene.create_urdf_loader()
        loader.fix_root_link = True
        path = fetch_without_visuals(tmp_path)
        robot = loader.load(str(path), srdf_file=str(path.with_suffix(".srdf")))
        made = FetchScene(scene, robot, {})
        made.set_arm(np.array(FETCH.rest_qpos_rad))
        return made

    return make


@pytest.fixture
def table_scene(make_scene: Callable[[], FetchScene]) -> FetchScene:
    """A table with a target box and two clutter boxes on it."""
    scene = make_scene()
    scene.add_table()
    scene.add_box("target", "object", (0.72, 0.05, 0.80), (0.07, 0.07, 0.10))
    scene.add_box("clutter0", "object", (0.75, 0.30, 0.82), (0.06, 0.16, 0.14))
    scene.add_box("clutter1", "object", (0.70, -0.22, 0.79), (0.08, 0.08, 0.08))
    return scene


@pytest.fixture
def drawer_at() -> Callable[..., ArticulationState]:
    """Makes a closed drawer with its handle at a point; it opens along -x, as far as asked."""

    def make(body: str, handle_m: tuple, travel_m: float) -> ArticulationState:
        return ArticulationState(
            kind="drawer",
            body=body,
            handle_m=np.array(handle_m),
            held=False,
            joint=0.0,
            limits=(0.0, travel_m),
            slides=True,
            axis=np.array((-1.0, 0.0, 0.0)),
            axis_point_m=np.zeros(3),
            frame=np.array((handle_m[0] + 0.37, handle_m[1], np.pi)),
        )

    return make


@pytest.fixture
def shelf_state(make_scene: Callable[[], FetchScene]) -> PrivilegedState:
    """A target in a box that is open towards the robot."""
    scene = make_scene()
    for name, height_m in (("floor", 0.79), ("roof", 1.21)):
        scene.add_box(name, "static", (0.95, 0.0, height_m), (0.5, 0.7, 0.02))
    for name, y_m in (("left", 0.36), ("right", -0.36)):
        scene.add_box(name, "static", (0.95, y_m, 1.0), (0.5, 0.02, 0.44))
    scene.add_box("target", "object", (0.9, 0.05, 0.851), (0.07, 0.07, 0.10))
    return scene.privileged("target")
