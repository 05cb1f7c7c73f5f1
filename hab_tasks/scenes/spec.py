"""What a scene is, before any simulator sees it: frozen data, z-up, metres, poses as seven numbers.

The same classes hold a ReplicaCAD layout and one of the embedded apartment's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hab_tasks.geometry import Pose7

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class CollisionSource:
    """Where a body's collision shapes come from.

    Attributes:
        kind: ``convex_parts`` (a mesh file, one convex part for each mesh in it) or ``box``.
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
    """A box in which objects can be placed, standing on a surface.

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
    """A template placed in the scene, under Habitat's handle (``template_:0000``)."""

    name: str
    template: ObjectTemplate
    world_from_object: Pose7
    dynamic: bool
    scale: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ArticulationInstance:
    """Furniture with joints, described by a URDF, with a fixed base."""

    name: str
    template: str
    urdf_file: Path
    world_from_root: Pose7
    scale: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Stage:
    """Floor and walls. Without a mesh (`visual_file` None) it is a shell of boxes."""

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
    """Everything needed to build one layout.

    Attributes:
        scene_id: e.g. ``v3_sc0_staging_00``.
        missing: Templates that the scene names but whose files the dataset does not have.
    """

    scene_id: str
    dataset: str
    stage: Stage
    objects: tuple[ObjectInstance, ...]
    articulations: tuple[ArticulationInstance, ...]
    receptacles: tuple[Receptacle, ...]
    lights: tuple[PointLight, ...]
    missing: tuple[str, ...] = ()
