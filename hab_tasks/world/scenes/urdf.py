"""URDF copies that SAPIEN can load: commas removed, absolute mesh paths, optional visuals.

ReplicaCAD's URDFs contain ``scale="1, 1, 1"``, which numpy 2 rejects. The copies are temporary; the
dataset is unchanged. Without a renderer SAPIEN cannot create materials, so copies for headless use
have no visuals. Their builders are parsed once for all scenes without a renderer.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.building.articulation_builder import ArticulationBuilder
from mani_skill.utils.building.urdf_loader import URDFLoader
from sapien import physx

from hab_tasks.io.cache import temporary_folder
from hab_tasks.world.scenes.fields import read_urdf
from hab_tasks.world.scenes.meshes import check_any_mesh
from hab_tasks.world.scenes.spec import HandleBar
from hab_tasks.world.scenes.urdf_checks import check_robot, mesh_file

_NUMERIC = ("xyz", "rpy", "scale", "size", "value", "rgba")
_READ = {
    "robot": ("link", "joint", "material"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
}
"""Elements passed to SAPIEN; faults in other, unused elements would make it fail."""


BAR_M, POST_M, POST_END_M = 0.014, 0.01, 0.02
"""Thickness of an added bar and of its posts, and distance of these from its ends."""


@lru_cache(maxsize=512)
def check_urdf(file: Path) -> None:
    """Raises DatasetError for a URDF that cannot be built, or a mesh of it that is damaged."""
    root = read_urdf(file)
    mend_numbers(root)
    check_robot(file, root)
    for mesh in root.iter("mesh"):
        check_any_mesh(mesh_file(file, mesh))


@contextmanager
def urdf_file(text: str, stem: str) -> Iterator[Path]:
    """Yields a temporary file ``STEM.urdf`` with this text."""
    folder = temporary_folder()
    try:
        path = folder / f"{stem}.urdf"
        path.write_text(text, encoding="utf-8")
        yield path
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@lru_cache(maxsize=512)
def sapien_urdf(file: Path, visuals: bool, bars: Sequence[HandleBar] = ()) -> str:
    """Returns the text of a URDF as SAPIEN can load it, with or without visuals, and with bars."""
    check_urdf(file)
    root = read_urdf(file)
    mend_numbers(root)
    for parent in (root, *root.findall("joint")):
        for element in [e for e in parent if e.tag not in _READ[parent.tag]]:
            parent.remove(element)
    for dynamics in root.iter("dynamics"):
        dynamics.attrib.setdefault("damping", "0")  # required by ManiSkill
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(mesh_file(file, mesh)))
    for link in root.findall("link"):
        for bar in bars:
            if bar.link == link.get("name"):
                _add_bar(link, bar)
    if not visuals:
        remove_visuals(root)
    return ElementTree.tostring(root, encoding="unicode")


def _add_bar(link: ElementTree.Element, bar: HandleBar) -> None:
    """Adds a bar on two posts to a link, in place."""
    x, y, z = bar.middle_m
    post_m = x - bar.front_m
    boxes = [((x, y, z), (BAR_M, BAR_M, bar.length_m))]
    for end in (-1, 1):
        center = (bar.front_m + post_m / 2, y, z + end * (bar.length_m / 2 - POST_END_M))
        boxes.append((center, (post_m, POST_M, POST_M)))
    for (center, size), kind in product(boxes, ("visual", "collision")):
        part = ElementTree.SubElement(link, kind)
        ElementTree.SubElement(part, "origin", xyz=" ".join(map(str, center)), rpy="0 0 0")
        geometry = ElementTree.SubElement(part, "geometry")
        ElementTree.SubElement(geometry, "box", size=" ".join(map(str, size)))


def mend_numbers(root: ElementTree.Element) -> None:
    """Replaces commas between numbers by blanks, in place."""
    for element in root.iter():
        for attribute in _NUMERIC:
            if element.get(attribute) is not None:
                element.set(
                    attribute, " ".join(element.get(attribute, "").replace(",", " ").split())
                )


def remove_visuals(root: ElementTree.Element) -> None:
    """Deletes every visual, in place."""
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)


@lru_cache(maxsize=512)
def joint_frictions(file: Path) -> dict[str, float]:
    """Returns joint name -> friction [N or N m] of the joints that state one."""
    stated = {}
    for joint in read_urdf(file).iter("joint"):
        dynamics = joint.find("dynamics")
        if dynamics is not None and dynamics.get("friction") is not None:
            stated[joint.get("name", "")] = float(dynamics.get("friction", 0))
    return stated


@lru_cache(maxsize=512)
def link_names(file: Path) -> tuple[str, ...]:
    """Returns the names of a URDF's links."""
    return tuple(link.get("name", "") for link in read_urdf(file).findall("link"))


MOST_PARSED = 256


@contextmanager
def articulation_builder(
    scene: ManiSkillScene,
    text: str,
    name: str,
    *,
    srdf: str | None = None,
    scale: float = 1.0,
    many_parts: bool = False,
) -> Iterator[ArticulationBuilder]:
    """Yields a builder of an articulation with a fixed root link, to be used before the exit.

    `text` is a URDF with absolute mesh paths, `srdf` its link pairs without collision. With
    `many_parts`, a collision mesh may have several convex parts.
    """
    # Materials of visuals belong to a renderer.
    parse = _parse if scene.can_render() else _parsed_once
    builder = parse(text, srdf, scale, many_parts)
    builder.scene = scene
    builder.set_name(name)
    builder.set_scene_idxs(None)
    for link in builder.link_builders:
        for record in link.collision_records:
            record.material = physx.get_default_material()  # those of the scene's settings
    try:
        yield builder
    finally:
        unset: Any = None
        builder.scene = unset  # would keep the whole simulation alive


def _parse(text: str, srdf: str | None, scale: float, many_parts: bool) -> ArticulationBuilder:
    loader = URDFLoader()
    # A scene is only asked for an empty builder.
    source: Any = _NewBuilders()
    loader.set_scene(source)
    loader.fix_root_link = True
    loader.scale = scale
    loader.load_multiple_collisions_from_file = many_parts
    with urdf_file(text, "articulation") as path:
        if srdf is not None:
            path.with_suffix(".srdf").write_text(srdf, encoding="utf-8")
        return loader.parse(str(path))["articulation_builders"][0]


_parsed_once = lru_cache(maxsize=MOST_PARSED)(_parse)


class _NewBuilders:
    """Stands for a scene while a URDF is parsed."""

    def create_articulation_builder(self) -> ArticulationBuilder:
        return ArticulationBuilder()
