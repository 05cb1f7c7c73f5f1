"""Data classes of the generator, and how it reads tables.

Lengths are in metres, masses in kilograms, angles in radians; frames are y-up, as in Habitat.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomllib
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vec3 = tuple[float, float, float]
PREFIX = "frl_apartment_"
WHOLE = ("apartment_bed", PREFIX, "0")  # beginnings of names that need no prefix


def read_table(name: str) -> dict[str, Any]:
    """Return the content of a TOML file of this folder."""
    return tomllib.loads(Path(__file__).with_name(name).read_text(encoding="utf-8"))


def full_name(template: str) -> str:
    """Return a template's name in the dataset."""
    return template if template.startswith(WHOLE) else PREFIX + template


@dataclass(frozen=True)
class Part:
    """A visible surface of one material; uv in metres, which the writer divides by the tile."""

    positions: Array  # (V, 3)
    normals: Array  # (V, 3)
    uv_m: Array  # (V, 2)
    faces: NDArray[np.int64]  # (F, 3)
    material: str


@dataclass(frozen=True)
class Box:
    """An axis-aligned collision box."""

    center: Vec3
    size: Vec3


@dataclass(frozen=True)
class Convex:
    """A closed convex collision mesh."""

    vertices: Array  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)


@dataclass(frozen=True)
class Receptacle:
    """A free volume whose bottom face lies on a supporting surface."""

    name: str
    center: Vec3
    half_extents: Vec3
    up: Vec3 = (0.0, 1.0, 0.0)
    link: str | None = None


@dataclass(frozen=True)
class ObjectModel:
    """A rigid object: visual geometry, collision geometry and entries of Habitat's config."""

    name: str
    category: str
    mass_kg: float
    parts: list[Part]
    solids: list[Convex]
    receptacles: list[Receptacle] = field(default_factory=list)
    friction: float = 0.6


@dataclass(frozen=True)
class Link:
    """One link of an articulation; an empty one has no mass, no shape and no mesh."""

    name: str
    mass_kg: float = 0.0
    parts: list[Part] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)


@dataclass(frozen=True)
class Joint:
    """A fixed, revolute or prismatic joint."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: Vec3 = (0.0, 0.0, 0.0)
    rpy: Vec3 = (0.0, 0.0, 0.0)
    axis: Vec3 = (1.0, 0.0, 0.0)
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 40.0


@dataclass(frozen=True)
class Articulation:
    """An articulated piece of furniture."""

    name: str
    parent_object: str
    links: list[Link]
    joints: list[Joint]
    receptacles: list[Receptacle] = field(default_factory=list)


@dataclass(frozen=True)
class StageModel:
    """The empty flat: floor and walls."""

    name: str
    parts: list[Part]
    solids: list[Convex]


@dataclass(frozen=True)
class Placement:
    """A template placed in a scene: rotated about its own x axis, then about +y."""

    template: str
    translation: Vec3
    yaw_rad: float = 0.0
    tilt_rad: float = 0.0
    dynamic: bool = False


@dataclass(frozen=True)
class SceneModel:
    """A furnished flat as data."""

    name: str
    stage: str
    lighting: str
    objects: list[Placement]
    articulations: list[Placement]


@dataclass(frozen=True)
class Light:
    """A point light."""

    position: Vec3
    intensity: float
    color: Vec3


@dataclass(frozen=True)
class Dataset:
    """Everything that the writer writes to disk."""

    stages: list[StageModel]
    objects: list[ObjectModel]
    articulations: list[Articulation]
    lightings: dict[str, list[Light]]
    scenes: list[SceneModel]
