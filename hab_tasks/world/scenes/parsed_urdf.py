"""Builders of articulations, parsed from URDF text once for all scenes without a renderer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.building.articulation_builder import ArticulationBuilder
from mani_skill.utils.building.urdf_loader import URDFLoader
from sapien import physx

from hab_tasks.world.scenes.urdf import urdf_file

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

    Args:
        scene: The scene to build in.
        text: The URDF, with absolute mesh paths.
        name: Name of the articulation.
        srdf: Link pairs without collision.
        scale: Scale of the articulation.
        many_parts: Whether a collision mesh may have several convex parts.
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
