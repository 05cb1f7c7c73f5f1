"""The true state of the simulation, for planners that may see it (S App. D)."""

from __future__ import annotations

import numpy as np

from hab_tasks.episodes.schema import Episode
from hab_tasks.privileged import CollisionBody, PrivilegedState
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.grasp import NOTHING, SnapGrasp
from hab_tasks.scenes.handles import SceneHandles
from hab_tasks.scenes.pool import BodyPool
from hab_tasks.scenes.shapes import components, matrix, read_body


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

    def read(self, episode: Episode, target: str) -> PrivilegedState:
        """Returns the present state.

        Args:
            episode: What is played.
            target: Handle of the object that the skill is about.
        """
        handles, agent = self._handles, self._agent
        robot = [(f"hab_fetch/{link.name}", link._objs[0]) for link in agent.robot.links]
        if not self._bodies:
            links = (read_body(name, "robot", body) for name, body in robot)
            self._bodies = (*self._pool.bodies(), *links)
        present = set(episode.objects) | set(handles.loose)
        poses = {
            name: matrix(body.entity_pose)
            for name, group, body in components(handles)
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
            target=target,
            held=self._names[held] if held != NOTHING else None,
            object_com_m={n: points[i] for i, n in enumerate(self._names) if n in present},
        )
