"""Converts an episode's names and poses to numbers: objects, handles, goals."""

from __future__ import annotations

import numpy as np
import sapien

from hab_tasks.engine.requirements import Requirements
from hab_tasks.episodes.schema import Episode
from hab_tasks.errors import EpisodeError
from hab_tasks.privileged import Array
from hab_tasks.robots.grasp import SnapGrasp
from hab_tasks.robots.handle import Handle
from hab_tasks.simulator import rigid_body, sapien_object
from hab_tasks.world.scenes.markers import HANDLE_MARKERS
from hab_tasks.world.scenes.scene_bodies import SceneBodies


class GoalSetting:
    """Looks up the bodies that episodes name in the active layout."""

    def __init__(
        self, requirements: Requirements, scene_bodies: SceneBodies, grasp: SnapGrasp
    ) -> None:
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
        """Returns the entries of `Goals` of one row.

        Args:
            episode: Episode of the row.
            starts_m: (K, 3) current centres of mass of the objects.
        """
        goals = np.array(starts_m)
        for number, target in enumerate(episode.targets):
            if target.world_from_goal is not None:
                pose = target.world_from_goal
                body = rigid_body(self._grasp.objects[self._names.index(target.object)])
                goals[number] = (
                    sapien.Pose(list(pose[:3]), list(pose[3:])) * body.cmass_local_pose
                ).p
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
    found = []
    scales = {a.name: a.scale for a in shown.spec.articulations}
    for name, furniture in shown.articulations.items():
        for marker in HANDLE_MARKERS:
            if marker.template == name.rsplit("_:", 1)[0]:
                x, y, z = (scales[name] * value for value in marker.offset_m)
                found.append(
                    Handle(
                        name=marker.name,
                        furniture_name=name,
                        furniture=furniture,
                        link=furniture.links_map[marker.link],
                        offset_m=(x, y, z),
                    )
                )
    return found


def frame_of(handle: Handle) -> tuple[float, float, float]:
    """Returns x, y and yaw of the frame facing out of the furniture."""
    pose = sapien_object(handle.furniture.links[0]).entity_pose
    x, y, _ = pose.p.tolist()
    ahead = pose.to_transformation_matrix()[:3, 0]
    return x, y, float(np.arctan2(ahead[1], ahead[0]))
