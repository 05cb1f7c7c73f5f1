"""The true state of the simulation, for planners that may see it (S App. D)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import sapien

from hab_tasks.episodes.schema import Episode
from hab_tasks.fronts import FrontKind
from hab_tasks.goals import Goals
from hab_tasks.privileged import CollisionBody, FrontState, PrivilegedState
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.grasp import NOTHING, SnapGrasp
from hab_tasks.scenes.handles import SceneHandles
from hab_tasks.scenes.pool import BodyPool
from hab_tasks.scenes.shapes import components, matrix, read_body
from hab_tasks.skills.goal_setting import frame_of


class GroundTruth:
    """Reads the one row of the CPU simulation."""

    def __init__(
        self, key: str, pool: BodyPool, handles: SceneHandles, agent: HabFetch, grasp: SnapGrasp
    ) -> None:
        """Reads what is shown now; `key` names it."""
        self._key, self._pool, self._handles = key, pool, handles
        self._agent, self._grasp = agent, grasp
        self._names = list(handles.movable)
        self._bodies: tuple[CollisionBody, ...] = ()

    def read(
        self, episode: Episode, goals: Goals, kinds: Sequence[FrontKind], handles: Sequence[int]
    ) -> PrivilegedState:
        """Returns the present state.

        Args:
            episode: What is played.
            goals: What it asks for.
            kinds: The doors and drawers that it is about ...
            handles: ... and the indices of their handles in the grasp.
        """
        shown, agent = self._handles, self._agent
        robot = [(f"hab_fetch/{link.name}", link._objs[0]) for link in agent.robot.links]
        if not self._bodies:
            links = (read_body(name, "robot", body) for name, body in robot)
            self._bodies = (*self._pool.bodies(), *links)
        present = set(episode.objects) | set(shown.loose)
        poses = {
            name: matrix(body.entity_pose)
            for name, group, body in components(shown)
            if group != "object" or name in present
        }
        poses.update({name: matrix(body.entity_pose) for name, body in robot})
        qpos = agent.robot._objs[0].get_qpos()
        held, arm = int(self._grasp.held[0]), agent.arm_index.tolist()
        points = self._grasp.objects_com_m()[0].numpy().astype(float)
        return PrivilegedState(
            scene_key=self._key,
            bodies=self._bodies,
            world_from_body=poses,
            world_from_base=matrix(agent.base_link._objs[0].entity_pose),
            arm_qpos=np.asarray(qpos[arm], dtype=float),
            locked_qpos={n: float(qpos[i]) for n, i in agent.joint_index.items() if i not in arm},
            held=self._names[held] if held != NOTHING else None,
            object_com_m={n: points[i] for i, n in enumerate(self._names) if n in present},
            targets=tuple(target.object for target in episode.targets),
            goals_m=np.array(goals.goals_m[0].tolist()).reshape(-1, 3),
            fronts=tuple(
                self._front(kind.name, index) for kind, index in zip(kinds, handles, strict=True)
            ),
            base_goal=np.array(goals.base[0].tolist()),
        )

    def _front(self, kind: str, index: int) -> FrontState:
        handle = self._grasp.handles[index]
        link: Any = handle.link._objs[0]
        axis = matrix(link.joint.global_pose)
        return FrontState(
            kind=kind,
            body=f"{handle.furniture_name}/{handle.link.name}",
            handle_m=(link.entity_pose * sapien.Pose(list(handle.offset_m))).p.astype(float),
            held=int(self._grasp.held_handle[0]) == index,
            joint=float(handle.furniture._objs[0].get_qpos()[handle.column]),
            limits=handle.limits,
            slides=link.joint.type == "prismatic",
            axis=axis[:3, 0],
            axis_point_m=axis[:3, 3],
            frame=np.array(frame_of(handle)),
        )
