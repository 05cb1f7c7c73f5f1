"""A layout in Habitat's terms: link ids, receptacles by body and position, markers.

Habitat refers to the links of furniture by number. Its URDF parser keeps joints in a map sorted by
name and attaches each joint's child to its parent in that order. Bullet then numbers the links
depth first: -1 for the root, 0 for the first child, and so on, fixed joints included. Hence the
fridge's ``top_door`` is link 2 although the file lists it before ``bottom_door``, and the drawer
``drawer3`` of the kitchen counter, joint ``right_slide_top``, is link 7.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from transforms3d import euler

from hab_tasks.articulations import HANDLE_MARKERS
from hab_tasks.episodes.schema import ReceptacleRef
from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.geometry import Array, to_matrix
from hab_tasks.world.scenes.fields import read_urdf
from hab_tasks.world.scenes.spec import Receptacle, SceneSpec
from hab_tasks.world.scenes.urdf import check_urdf

HABITAT_MARKERS = (
    "cab_push_point_7",
    "cab_push_point_6",
    "cab_push_point_5",
    "cab_push_point_4",
    "fridge_push_point",
)
"""Markers of Habitat's episodes, in its order."""

_MOVABLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, kw_only=True, eq=False)
class UrdfLink:
    """A link of a URDF.

    Attributes:
        id: Habitat's link id, -1 for the root.
        joint: Its movable joint; None for the root and for fixed joints.
        root_from_link: Its pose (4, 4) with all joints at zero, before the furniture's scale.
    """

    id: int
    name: str
    joint: str | None
    root_from_link: Array


@lru_cache(maxsize=256)
def urdf_links(file: Path) -> tuple[UrdfLink, ...]:
    """Returns the links of a URDF in Habitat's order, by their ids.

    Raises:
        DatasetError: The URDF is absent, damaged or not one tree.
    """
    check_urdf(file)
    robot = read_urdf(file)
    children: dict[str, list[ElementTree.Element]] = defaultdict(list)
    for joint in sorted(robot.findall("joint"), key=lambda joint: joint.get("name", "")):
        children[_end(joint, "parent")].append(joint)
    hung = {_end(joint, "child") for joints in children.values() for joint in joints}
    names = [link.get("name", "") for link in robot.findall("link")]
    roots = [name for name in names if name not in hung]
    links: list[UrdfLink] = []

    def add(name: str, joint: ElementTree.Element | None, root_from_link: Array) -> None:
        moves = joint is not None and joint.get("type") in _MOVABLE
        links.append(
            UrdfLink(
                id=len(links) - 1,
                name=name,
                joint=joint.get("name", "") if joint is not None and moves else None,
                root_from_link=root_from_link,
            )
        )
        for child in children[name]:
            add(_end(child, "child"), child, root_from_link @ _origin(child))

    if len(roots) == 1:
        add(roots[0], None, np.eye(4))
    if sorted(link.name for link in links) != sorted(names):
        raise DatasetError(f"{file}: its links are not one tree (roots: {', '.join(roots)}).")
    return tuple(links)


class HabitatLayout:
    """Converts the names of one layout's furniture and receptacles."""

    def __init__(self, spec: SceneSpec) -> None:
        self._spec = spec
        self._links = {a.name: urdf_links(a.urdf_file) for a in spec.articulations}
        self._world_from = {o.name: to_matrix(o.world_from_object) for o in spec.objects}
        for furniture in spec.articulations:
            root = to_matrix(furniture.world_from_root)
            for link in self._links[furniture.name]:
                local = link.root_from_link.copy()
                local[:3, 3] *= furniture.scale
                self._world_from[f"{furniture.name}/{link.name}"] = root @ local
        self._receptacles: dict[str, list[Receptacle]] = defaultdict(list)
        for receptacle in spec.receptacles:
            self._receptacles[receptacle.body].append(receptacle)

    def joint(self, furniture: str, link_id: int) -> str:
        """Returns the joint that moves a link.

        Raises:
            UnknownNameError: Unknown furniture, or no joint moves that link.
        """
        movable = {str(x.id): x.joint for x in self._furniture(furniture) if x.joint}
        if str(link_id) not in movable:
            raise UnknownNameError(f"movable link of {furniture}", str(link_id), movable)
        return movable[str(link_id)]

    def link_of_joint(self, furniture: str, joint: str) -> int:
        """Returns the id of the link that a joint moves.

        Raises:
            UnknownNameError: Unknown furniture or joint.
        """
        ids = {link.joint: link.id for link in self._furniture(furniture) if link.joint}
        if joint not in ids:
            raise UnknownNameError(f"joint of {furniture}", joint, ids)
        return ids[joint]

    def instance_and_link(self, body: str) -> tuple[str, int | None]:
        """Returns an object's or furniture's handle, and the link id (None for an object).

        Raises:
            UnknownNameError: Unknown furniture or link.
        """
        handle, _, name = body.partition("/")
        if not name:
            return handle, None
        ids = {link.name: link.id for link in self._furniture(handle)}
        if name not in ids:
            raise UnknownNameError(f"link of {handle}", name, ids)
        return handle, ids[name]

    def receptacle(
        self, handle: str | None, link_id: int | None, name: str | None, point_m: Array
    ) -> ReceptacleRef | None:
        """Returns the receptacle that an entry of Habitat refers to.

        Habitat gives only the body of a goal receptacle, and not always the name of a start
        receptacle. Of several candidates, the one whose box is nearest is returned.

        Args:
            handle: The body that carries it, None if unknown.
            link_id: The link that carries it, None for an object.
            name: Its name, None if unknown.
            point_m: Centre (3,) of the object on it, in the world.

        Raises:
            UnknownNameError: The layout has no such receptacle, link or object.
        """
        if name is not None:
            self.check_receptacle(name)
        if handle is not None:
            found = self._receptacles[self._body(handle, link_id)]
            named = [r for r in found if r.name == name]
        elif name is not None:
            found = named = [r for r in self._spec.receptacles if r.name == name]
        else:
            return None
        best = min(named or found, key=lambda r: self._distance(r, point_m))
        return best.name, best.body

    def check_receptacle(self, name: str) -> None:
        """Raises UnknownNameError if the layout has no receptacle of this name."""
        names = {receptacle.name for receptacle in self._spec.receptacles}
        if name not in names:
            raise UnknownNameError(f"receptacle in {self._spec.scene_id}", name, names)

    def markers(self, also: str | None) -> list[dict[str, Any]]:
        """Returns Habitat's markers of this layout, and the one named `also`."""
        wanted = (*HABITAT_MARKERS, *([also] if also not in HABITAT_MARKERS else []))
        here = [m for m in HANDLE_MARKERS if f"{m.template}_:0000" in self._links]
        known = {marker.name: marker for marker in here}
        return [
            {
                "name": marker.name,
                "type": "articulated_object",
                "params": {
                    "offset": list(marker.offset_m),
                    "link": marker.link,
                    "object": f"{marker.template}_:0000",
                },
            }
            for marker in (known[name] for name in wanted if name in known)
        ]

    def _furniture(self, handle: str) -> tuple[UrdfLink, ...]:
        if handle not in self._links:
            raise UnknownNameError(f"furniture in {self._spec.scene_id}", handle, self._links)
        return self._links[handle]

    def _body(self, handle: str, link_id: int | None) -> str:
        body = handle
        if link_id is not None:
            names = {str(link.id): link.name for link in self._furniture(handle)}
            if str(link_id) not in names:
                raise UnknownNameError(f"link of {handle}", str(link_id), names)
            body = f"{handle}/{names[str(link_id)]}"
        if body not in self._receptacles:
            kind = f"body with receptacles in {self._spec.scene_id}"
            raise UnknownNameError(kind, body, self._receptacles)
        return body

    def _distance(self, receptacle: Receptacle, point_m: Array) -> tuple[float, float]:
        """Returns the distances [m] of a point to a receptacle's box and to the box's centre."""
        world_from_box = self._world_from[receptacle.body] @ to_matrix(receptacle.body_from_box)
        local = world_from_box[:3, :3].T @ (point_m - world_from_box[:3, 3])
        outside = np.maximum(np.abs(local) - np.array(receptacle.half_size_m), 0.0)
        return float(np.linalg.norm(outside)), float(np.linalg.norm(local))


def _end(joint: ElementTree.Element, kind: str) -> str:
    end = joint.find(kind)
    return end.get("link", "") if end is not None else ""


def _origin(joint: ElementTree.Element) -> Array:
    """Returns a joint's ``parent_from_child`` (4, 4) at zero."""
    origin = joint.find("origin")
    xyz, rpy = (
        [float(x) for x in (origin.get(key, "0 0 0") if origin is not None else "0 0 0").split()]
        for key in ("xyz", "rpy")
    )
    matrix = np.eye(4)
    matrix[:3, :3] = euler.euler2mat(*rpy, axes="sxyz")
    matrix[:3, 3] = xyz
    return matrix
