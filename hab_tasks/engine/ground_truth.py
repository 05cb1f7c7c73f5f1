"""Reads the privileged state of the simulation for planners (S App. D)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import sapien

from hab_tasks.articulations import ArticulationKind
from hab_tasks.engine.goals import Goals, frame_of
from hab_tasks.episodes.schema import Episode
from hab_tasks.privileged import Array, ArticulationState, CollisionBody, PrivilegedState
from hab_tasks.robots.grasp import NOTHING, Grasp
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import sapien_object
from hab_tasks.world.scenes.pool import BodyPool, SceneBodies, components, matrix, read_body

FIXED = ("stage", "static")
"""Groups of bodies that do not move."""


class Poses(Mapping[str, Array]):
    """Poses (4, 4) of bodies by name, converted to matrices when they are read."""

    def __init__(self, fixed: Mapping[str, Array], moving: Mapping[str, sapien.Pose]) -> None:
        """Takes the poses of one step: those of bodies that never move, and of the others."""
        self._fixed, self._moving = fixed, moving
        self._read: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        found = self._fixed.get(name)
        found = self._read.get(name) if found is None else found
        if found is None:
            found = self._read[name] = matrix(self._moving[name])
        return found

    def __iter__(self) -> Iterator[str]:
        yield from self._fixed
        yield from self._moving

    def __len__(self) -> int:
        return len(self._fixed) + len(self._moving)

    def __reduce__(self) -> tuple[type[dict[str, Array]], tuple[dict[str, Array]]]:
        # Sent to another process as matrices; SAPIEN's poses stay in this one.
        return dict, (dict(self),)


class GroundTruth:
    """Reads the privileged state of one simulation."""

    def __init__(
        self,
        key: str,
        pool: BodyPool,
        scene_bodies: SceneBodies,
        agent: MobileManipulator,
        grasp: Grasp,
    ) -> None:
        """Reads the geometry of the active layout; `key` becomes its `scene_key`."""
        self._key, self._pool, self._scene_bodies = key, pool, scene_bodies
        self._agent, self._grasp = agent, grasp
        self._names = list(scene_bodies.movable)
        self._bodies: tuple[CollisionBody, ...] = ()
        self._fixed: dict[str, Array] = {}
        self._moving: list[tuple[str, str, Any]] = []
        self._links: list[tuple[str, Any]] = []

    def read(
        self,
        episode: Episode,
        goals: Goals,
        kinds: Sequence[ArticulationKind],
        handles: Sequence[int],
    ) -> PrivilegedState:
        """Returns the current state.

        `goals` is a batch of one; `handles` are the indices in the grasp of those of the doors and
        drawers `kinds`.
        """
        shown, agent = self._scene_bodies, self._agent
        # On demand, as only planners ask, and the meshes of a layout are many.
        if not self._bodies:
            self._bodies = self._read_bodies()
        present = set(episode.objects) | set(shown.loose)
        moving = {
            name: body.entity_pose
            for name, group, body in self._moving
            if group != "object" or name in present
        }
        moving.update({name: body.entity_pose for name, body in self._links})
        qpos = sapien_object(agent.robot).get_qpos()
        held, arm = self._grasp.held, agent.arm_index.tolist()
        points = self._grasp.objects_com_m().astype(float)
        return PrivilegedState(
            scene_key=self._key,
            bodies=self._bodies,
            world_from_body=Poses(self._fixed, moving),
            world_from_base=matrix(sapien_object(agent.base_link).entity_pose),
            arm_qpos=np.asarray(qpos[arm], dtype=float),
            locked_qpos={n: float(qpos[i]) for n, i in agent.joint_index.items() if i not in arm},
            held=self._names[held] if held != NOTHING else None,
            object_com_m={n: points[i] for i, n in enumerate(self._names) if n in present},
            targets=tuple(target.object for target in episode.targets),
            goals_m=np.array(goals.goals_m[0].tolist()).reshape(-1, 3),
            articulations=self.articulations(kinds, handles),
            base_goal=np.array(goals.base[0].tolist()),
        )

    def _read_bodies(self) -> tuple[CollisionBody, ...]:
        """Returns all bodies; notes the poses of those that stand still, which are most."""
        links, uid = self._agent.robot.links, self._agent.spec.uid
        self._links = [(f"{uid}/{link.name}", sapien_object(link)) for link in links]
        for name, group, body in components(self._scene_bodies):
            if group in FIXED:
                self._fixed[name] = matrix(body.entity_pose)
            else:
                self._moving.append((name, group, body))
        links = (read_body(name, "robot", body) for name, body in self._links)
        return (*self._pool.bodies(), *links)

    def articulations(
        self, kinds: Sequence[ArticulationKind], handles: Sequence[int]
    ) -> tuple[ArticulationState, ...]:
        """Returns the current state of doors and drawers; arguments as in `read`."""
        pairs = zip(kinds, handles, strict=True)
        return tuple(self._articulation(kind.name, index) for kind, index in pairs)

    def _articulation(self, kind: str, index: int) -> ArticulationState:
        handle = self._grasp.handles[index]
        link = handle.body
        # SAPIEN's joints move along or about the x axis of their frame.
        axis = matrix(link.joint.global_pose)
        return ArticulationState(
            kind=kind,
            body=f"{handle.furniture_name}/{handle.link.name}",
            handle_m=np.asarray(handle.pose().p, dtype=float),
            held=self._grasp.held_handle == index,
            joint=handle.joint(),
            limits=handle.limits,
            slides=link.joint.type == "prismatic",
            axis=axis[:3, 0],
            axis_point_m=axis[:3, 3],
            frame=np.array(frame_of(handle)),
        )
