"""Requirements of a skill or task on episodes, and the goals of a batch of episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from torch import Tensor

from hab_tasks.arrays import Floats, put_rows, to_tensor
from hab_tasks.articulations import HANDLE_MARKERS, ArticulationKind
from hab_tasks.episodes.schema import Episode
from hab_tasks.errors import EpisodeError
from hab_tasks.privileged import Array
from hab_tasks.robots.grasp import Grasp
from hab_tasks.robots.handle import Handle
from hab_tasks.simulator import rigid_body, sapien_object
from hab_tasks.world.scenes.build import to_sapien
from hab_tasks.world.scenes.pool import SceneBodies


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Parts of an episode that a skill or task uses.

    Attributes:
        objects: Number of objects to rearrange.
        articulations: The doors and drawers whose state is used.
        names_articulation: Whether each episode names its door or drawer, as in skills; in tasks,
            the layout determines it.
        goals: Whether each object has a goal position.
        holds: Whether the first object starts in the grasp.
        names_navigation_goal: Whether each episode names a navigation goal.
        navigates: Whether geodesic distances of the base are measured.
        takes: What the hand snaps to: ``objects``, ``handles``, or ``any`` (objects first).
    """

    objects: int = 1
    articulations: tuple[ArticulationKind, ...] = ()
    names_articulation: bool = False
    goals: bool = False
    holds: bool = False
    names_navigation_goal: bool = False
    navigates: bool = False
    takes: Literal["objects", "handles", "any"] = "objects"


@dataclass(frozen=True, kw_only=True)
class Goals:
    """Goals; constant during an episode. N rows, K objects to rearrange, J doors and drawers.

    Attributes:
        starts_m: (N, K, 3) start positions of the objects' centres of mass.
        goals_m: (N, K, 3) their goal positions; the start where nothing is to be placed.
        joint_lower: (N, J) lower limit of the doors' and drawers' joints [m or rad].
        joint_upper: (N, J) upper limit.
        articulation_frame: (N, J, 3) x [m], y [m], yaw [rad] of the frame facing out of the
            furniture.
        base: (N, 3) x [m], y [m], yaw [rad] of the navigation goal.
        rest_m: (N, 3) resting position of the end-effector, base frame.
    """

    starts_m: Floats
    goals_m: Floats
    joint_lower: Floats
    joint_upper: Floats
    articulation_frame: Floats
    base: Floats
    rest_m: Floats

    @staticmethod
    def empty(count: int, objects: int, articulations: int) -> Goals:
        """Returns goals of zeros, with joint travels of one, for a number of rows."""

        def zeros(*shape: int) -> Floats:
            return np.zeros((count, *shape), dtype=np.float32)

        return Goals(
            starts_m=zeros(objects, 3),
            goals_m=zeros(objects, 3),
            joint_lower=zeros(articulations),
            # A share of the travel is computed in rows without an episode too.
            joint_upper=zeros(articulations) + 1.0,
            articulation_frame=zeros(articulations, 3),
            base=zeros(3),
            rest_m=zeros(3),
        )

    def state(self) -> dict[str, Tensor]:
        """Returns copies of all entries by name."""
        return {f.name: to_tensor(getattr(self, f.name)) for f in fields(self)}

    def changed(self, rows: Sequence[int], values: Mapping[str, Any]) -> Goals:
        """Returns goals with `values` (R, ...) in `rows` (R,)."""
        old = {f.name: getattr(self, f.name) for f in fields(self)}
        new = {name: put_rows(old[name], rows, value) for name, value in values.items()}
        return Goals(**old | new)


class GoalSetting:
    """Looks up the bodies that episodes name in the active layout."""

    def __init__(self, requirements: Requirements, scene_bodies: SceneBodies, grasp: Grasp) -> None:
        self._needs, self._shown, self._grasp = requirements, scene_bodies, grasp
        self._names = list(scene_bodies.movable)

    def targets(self, episode: Episode) -> list[int]:
        """Returns the grasp index of each object to rearrange."""
        return [self._names.index(target.object) for target in episode.targets]

    def handles(self, episode: Episode) -> list[int]:
        """Returns the grasp index of the handle of each required door or drawer.

        Raises:
            EpisodeError: The layout has no such handle.
        """
        ref, kinds = episode.handle, self._needs.articulations
        if ref is not None and self._needs.names_articulation:
            return [self._handle(episode, ref.marker, ref.furniture)]
        return [self._handle(episode, kind.marker, None) for kind in kinds]

    def _handle(self, episode: Episode, marker: str, furniture: str | None) -> int:
        for index, handle in enumerate(self._grasp.handles):
            if handle.name == marker and furniture in (None, handle.furniture_name):
                return index
        raise EpisodeError(f"{episode.id}: no handle {marker} in {episode.scene_id}.")

    def values(self, episode: Episode, starts_m: Array) -> dict[str, Array]:
        """Returns a row's entries of `Goals`, its objects' centres of mass being at (K, 3)."""
        goals = np.array(starts_m)
        for number, target in enumerate(episode.targets):
            if target.world_from_goal is not None:
                pose = target.world_from_goal
                # The episode has the pose of the body's frame; measures are of its centre of mass.
                body = rigid_body(self._grasp.objects[self._names.index(target.object)])
                goals[number] = (to_sapien(pose) * body.cmass_local_pose).p
        articulations = [self._grasp.handles[index] for index in self.handles(episode)]
        limits = np.array([handle.limits for handle in articulations]).reshape(-1, 2)
        base = episode.navigation.base if episode.navigation is not None else (0.0, 0.0, 0.0)
        return {
            "starts_m": starts_m,
            "goals_m": goals,
            "joint_lower": limits[:, 0],
            "joint_upper": limits[:, 1],
            "articulation_frame": np.array([frame_of(handle) for handle in articulations]).reshape(
                -1, 3
            ),
            "base": np.array(base),
        }


def handles_of(shown: SceneBodies) -> list[Handle]:
    """Returns every handle marker of the active furniture."""
    instances = {one.name: one for one in shown.spec.articulations}
    return [
        Handle(
            name=marker.name,
            furniture_name=name,
            furniture=furniture,
            link=furniture.links_map[marker.link],
            offset_m=instances[name].handle_m(marker),
        )
        for name, furniture in shown.articulations.items()
        for marker in HANDLE_MARKERS
        if marker.template == instances[name].template
    ]


def frame_of(handle: Handle) -> tuple[float, float, float]:
    """Returns x, y and yaw of the frame facing out of the furniture."""
    pose = sapien_object(handle.furniture.links[0]).entity_pose
    x, y, _ = pose.p.tolist()
    ahead = pose.to_transformation_matrix()[:3, 0]
    return x, y, float(np.arctan2(ahead[1], ahead[0]))
