"""Data model of a scene, independent of the simulator: frozen, z-up, metres, seven-number poses.

ReplicaCAD's layouts and those of the embedded apartment use the same classes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hab_tasks.articulations import HandleMarker
from hab_tasks.geometry import Pose7

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class CollisionSource:
    """Source of a body's collision shapes.

    Attributes:
        kind: ``convex_parts`` (a mesh file with one convex part per mesh) or ``box``.
        file: The mesh file, None for a box.
        center_m: Centre of the box in the body frame.
        half_size_m: Half extents of the box.
    """

    kind: Literal["convex_parts", "box"]
    file: Path | None = None
    center_m: Vector = (0.0, 0.0, 0.0)
    half_size_m: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Receptacle:
    """A box on a surface in which objects can be placed.

    Attributes:
        name: As in the dataset, e.g. ``receptacle_aabb_Sofa_frl_apartment_sofa``.
        body: Name of the object instance, or ``articulation/link``, that carries it.
        body_from_box: Pose of the box's centre; the box's axes.
        half_size_m: Half extents along these axes, always positive.
        up: Unit vector of the box frame that points away from the supporting surface.
    """

    name: str
    body: str
    body_from_box: Pose7
    half_size_m: Vector
    up: Vector


@dataclass(frozen=True, kw_only=True)
class ObjectTemplate:
    """A rigid object as the dataset describes it; `up` is its upright axis in its own frame."""

    name: str
    visual_file: Path | None
    collision: tuple[CollisionSource, ...]
    mass_kg: float | None
    friction: float
    up: Vector
    receptacles: tuple[Receptacle, ...] = ()
    category: str = ""


@dataclass(frozen=True, kw_only=True)
class ObjectInstance:
    """A template placed in the scene, with a name that is Habitat's handle (``template_:0000``)."""

    name: str
    template: ObjectTemplate
    world_from_object: Pose7
    dynamic: bool
    scale: float = 1.0


@dataclass(frozen=True, kw_only=True)
class HandleBar:
    """A bar in front of a link, along its z axis, before the furniture is scaled.

    Attributes:
        front_m: x of the link's front, from which two posts carry the bar.
    """

    link: str
    middle_m: Vector
    length_m: float
    front_m: float


@dataclass(frozen=True, kw_only=True)
class ArticulationInstance:
    """Articulated furniture with a fixed base, described by a URDF.

    Attributes:
        bars: Bars added to its doors and drawers.
    """

    name: str
    template: str
    urdf_file: Path
    world_from_root: Pose7
    scale: float = 1.0
    bars: tuple[HandleBar, ...] = ()

    def handle_m(self, marker: HandleMarker) -> Vector:
        """Returns the place of a handle in the frame of its link: in the middle of an added bar."""
        bars = {bar.link: bar.middle_m for bar in self.bars}
        x, y, z = (self.scale * value for value in bars.get(marker.link, marker.offset_m))
        return x, y, z


@dataclass(frozen=True, kw_only=True)
class Stage:
    """Stage mesh: floor and walls. Without a mesh (`visual_file` None), a shell of boxes."""

    name: str
    visual_file: Path | None
    collision: tuple[CollisionSource, ...]
    world_from_stage: Pose7
    friction: float


@dataclass(frozen=True, kw_only=True)
class PointLight:
    """A point light in the world; colour times intensity, arbitrary units."""

    position_m: Vector
    color: Vector


@dataclass(frozen=True, kw_only=True)
class SceneSpec:
    """Description of one layout.

    Attributes:
        scene_id: e.g. ``v3_sc0_staging_00``.
        missing: Templates named by the scene whose files the dataset lacks.
    """

    scene_id: str
    dataset: str
    stage: Stage
    objects: tuple[ObjectInstance, ...]
    articulations: tuple[ArticulationInstance, ...]
    receptacles: tuple[Receptacle, ...]
    lights: tuple[PointLight, ...]
    missing: tuple[str, ...] = ()
