"""Visual geometry of bodies as data, for sensors that work without a renderer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

from transforms3d.euler import euler2quat

from hab_tasks.geometry import IDENTITY, Pose7, pose
from hab_tasks.world.scenes.meshes import textured_glb
from hab_tasks.world.scenes.spec import ObjectTemplate, Stage
from hab_tasks.world.scenes.urdf import sapien_urdf

VisualKind = Literal["mesh", "box", "sphere", "cylinder", "capsule"]


@dataclass(frozen=True, kw_only=True)
class Visual:
    """One visual shape of a body.

    Attributes:
        kind: Its shape.
        body_from_visual: Its pose; cylinders and capsules extend along z.
        file: The mesh file, None for other shapes.
        size: Scale of a mesh along its axes; half extents of a box [m]; radius of a sphere [m];
            radius and half length of a cylinder, or of a capsule between its caps [m].
    """

    kind: VisualKind
    body_from_visual: Pose7 = IDENTITY
    file: Path | None = None
    size: tuple[float, ...] = (1.0, 1.0, 1.0)


Visuals = tuple[Visual, ...]


def visual_file(template: ObjectTemplate) -> Path | None:
    """Returns the mesh file to draw for a template: scans with a large texture as a light copy."""
    file = template.visual_file
    return textured_glb(file) if file is not None and file.suffix == ".obj" else file


def template_visuals(template: ObjectTemplate, scale: float) -> Visuals:
    """Returns the visuals of an object."""
    file = visual_file(template)
    return () if file is None else (Visual(kind="mesh", file=file, size=(scale,) * 3),)


def stage_visuals(stage: Stage) -> Visuals:
    """Returns the visuals of floor and walls."""
    if stage.visual_file is not None:
        return (Visual(kind="mesh", file=stage.visual_file),)
    return tuple(
        Visual(
            kind="box", body_from_visual=(*source.center_m, *IDENTITY[3:]), size=source.half_size_m
        )
        for source in stage.collision
    )


def furniture_visuals(urdf_file: Path, scale: float) -> dict[str, Visuals]:
    """Returns link name -> visuals of articulated furniture."""
    return urdf_visuals(sapien_urdf(urdf_file, visuals=True), scale)


def urdf_visuals(text: str, scale: float = 1.0) -> dict[str, Visuals]:
    """Returns link name -> visuals of a URDF with absolute mesh paths."""
    root = ElementTree.fromstring(text)
    return {
        link.get("name", ""): tuple(
            shape for visual in link.findall("visual") for shape in _shapes(visual, scale)
        )
        for link in root.findall("link")
    }


def _shapes(visual: ElementTree.Element, scale: float) -> Visuals:
    geometry = visual.find("geometry")
    if geometry is None:
        return ()
    origin = visual.find("origin")
    at: Pose7 = IDENTITY
    if origin is not None:
        xyz = [scale * x for x in _numbers(origin, "xyz", (0.0,) * 3)]
        roll, pitch, yaw = _numbers(origin, "rpy", (0.0,) * 3)
        at = pose(tuple(xyz), euler2quat(roll, pitch, yaw))
    return tuple(_shape(shape, at, scale) for shape in geometry)


def _shape(shape: ElementTree.Element, at: Pose7, scale: float) -> Visual:
    if shape.tag == "mesh":
        sizes = [scale * x for x in _numbers(shape, "scale", (1.0,) * 3)]
        sizes = sizes * 3 if len(sizes) == 1 else sizes
        file = Path(shape.get("filename", ""))
        return Visual(kind="mesh", body_from_visual=at, file=file, size=tuple(sizes))
    if shape.tag == "box":
        half = tuple(scale * x / 2 for x in _numbers(shape, "size", (0.0,) * 3))
        return Visual(kind="box", body_from_visual=at, size=half)
    radius = scale * float(shape.get("radius", 0.0))
    if shape.tag == "sphere":
        return Visual(kind="sphere", body_from_visual=at, size=(radius,))
    kind: VisualKind = "capsule" if shape.tag == "capsule" else "cylinder"
    size = (radius, scale * float(shape.get("length", 0.0)) / 2)
    return Visual(kind=kind, body_from_visual=at, size=size)


def _numbers(
    element: ElementTree.Element, name: str, default: tuple[float, ...]
) -> tuple[float, ...]:
    text = element.get(name)
    return default if text is None else tuple(float(x) for x in text.split())
