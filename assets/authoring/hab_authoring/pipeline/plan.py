"""Plan of an optimised copy of a dataset: files to copy, to rewrite and to compute."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from transforms3d.euler import euler2mat

from hab_authoring.pipeline.collision import write_parts
from hab_authoring.pipeline.jobs import AssetOptions, Job
from hab_authoring.pipeline.visuals import texture_file, write_light_glb, write_light_obj
from hab_tasks.errors import DatasetError
from hab_tasks.world.scenes.fields import read_json, read_urdf
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_template
from hab_tasks.world.scenes.meshes import content_key, mesh_bounds, parts_volume
from hab_tasks.world.scenes.objects import DEFAULT_DENSITY_KG_M3
from hab_tasks.world.scenes.spec import ObjectTemplate
from hab_tasks.world.scenes.urdf import mend_numbers
from hab_tasks.world.scenes.urdf_checks import check_robot, mesh_file

PARTS_FOLDER = Path("objects/convex")

SAPIEN_LEFTOVERS = (".convex.stl", ".nonconvex.stl", ".coacd.ply")
"""SAPIEN's own caches, made from the meshes that lie beside them."""

ASSETS_FOLDER = "assets"
"""Subfolder of the cache."""

_DECLARATION = '<?xml version="1.0"?>\n'


@dataclass(frozen=True, kw_only=True)
class CopyPlan:
    """One folder's copy. All targets are relative to its root.

    Attributes:
        root: The folder.
        options: How it is optimised.
        jobs: Target -> job that computes it: a file, or the files of a folder.
        visuals: Targets that are light copies of the GLB at the same place.
        texts: Target -> new text of a configuration.
        left_out: Files that are replaced by others.
    """

    root: Path
    options: AssetOptions
    jobs: dict[Path, Job] = field(default_factory=dict)
    visuals: set[Path] = field(default_factory=set)
    texts: dict[Path, str] = field(default_factory=dict)
    left_out: set[Path] = field(default_factory=set)

    def copied(self) -> Iterator[Path]:
        """Yields the files that are copied as they are."""
        for folder, _, names in os.walk(self.root, followlinks=True):
            for name in sorted(names):
                target = (Path(folder) / name).relative_to(self.root)
                planned = target in self.jobs or target in self.texts or target in self.left_out
                if not planned and not name.endswith(SAPIEN_LEFTOVERS):
                    yield target

    def inside(self, file: Path) -> Path:
        """Returns a file's target.

        Raises:
            DatasetError: It is not in the folder, so the copy could not hold it.
        """
        if not file.is_relative_to(self.root):
            raise DatasetError(f"{file}: lies outside {self.root}, so a copy would lack it.")
        return file.relative_to(self.root)

    def lighten(self, file: Path) -> None:
        """Plans a light copy of a visual mesh; formats other than GLB stay as they are."""
        if file.suffix == ".glb":
            name = f"{ASSETS_FOLDER}/{content_key(file)}-{self.options.visual_key}.glb"
            write = partial(write_light_glb, file, self.options)
            self.jobs[self.inside(file)] = Job(name=name, source=file, write=write)
            self.visuals.add(self.inside(file))

    def add_parts(self, target: Path, own: Path | None, visual: Path) -> None:
        """Plans a file of collision parts."""
        key = _key([visual] if own is None else [own, visual])
        name = f"{ASSETS_FOLDER}/{key}-{self.options.collision_key}{target.suffix}"
        write = partial(write_parts, own, visual, self.options)
        self.jobs[target] = Job(name=name, source=own or visual, write=write)


def plan_dataset(dataset: SceneDataset, options: AssetOptions) -> CopyPlan:
    """Plans the copy of a scene dataset.

    Raises:
        DatasetError: A configuration is damaged.
    """
    plan = CopyPlan(root=dataset.root, options=options)
    for name, file in dataset.object_files.items():
        _plan_object(plan, name, file)
    for file in dataset.stage_files.values():
        visual = _mesh(file, read_json(file).get("render_asset"))
        if visual is not None:
            plan.lighten(visual)
    for file in sorted((dataset.root / "urdf").rglob("*.urdf")):
        _plan_urdf(plan, file)
    return plan


def plan_objects(root: Path, options: AssetOptions) -> CopyPlan:
    """Plans the copy of a YCB folder, in either layout that the loader reads.

    Raises:
        DatasetError: It holds no object.
    """
    plan = CopyPlan(root=root, options=options)
    visuals = sorted((*root.glob("*/google_16k/textured.obj"), *root.glob("models/*/textured.obj")))
    if not visuals:
        raise DatasetError(f"{root}: holds no NNN_name/google_16k/textured.obj.")
    for visual in visuals:
        is_google = visual.parent.name == "google_16k"
        own = visual.with_name("textured_vhacd.stl" if is_google else "collision.ply")
        plan.add_parts(plan.inside(own), own if own.exists() else None, visual)
        texture = texture_file(visual)
        name = f"{_key([visual, texture])}-{options.visual_key}"
        job = Job(
            name=f"{ASSETS_FOLDER}/{name}",
            source=visual,
            write=partial(write_light_obj, visual, texture, options),
        )
        plan.jobs[plan.inside(visual.parent)] = job
        own_files = (visual, visual.with_suffix(".mtl"), texture)
        plan.left_out.update(plan.inside(file) for file in own_files)
    return plan


def _plan_object(plan: CopyPlan, name: str, file: Path) -> None:
    template = load_template(file)
    if template is None or template.visual_file is None:
        return
    visual, data = template.visual_file, read_json(file)
    plan.lighten(visual)
    if data.get("use_bounding_box_for_collision"):
        return
    own = _mesh(file, data.get("collision_asset"))
    # A mass that follows from the volume has to stay what it was.
    data.setdefault("mass", round(_mass_kg(template), 6))
    if plan.options.collision == "box":
        data.pop("collision_asset", None)
        data["use_bounding_box_for_collision"] = True
    else:
        target = PARTS_FOLDER / f"{name}_{plan.options.collision}.glb"
        plan.add_parts(target, own, visual)
        data["collision_asset"] = os.path.relpath(plan.root / target, file.parent)
    if own is not None and own != visual:
        plan.left_out.add(plan.inside(own))
    plan.texts[plan.inside(file)] = json.dumps(data, indent=2) + "\n"


def _plan_urdf(plan: CopyPlan, file: Path) -> None:
    root = read_urdf(file)
    mend_numbers(root)
    check_robot(file, root)
    for link in root.iter("link"):
        for mesh in link.iterfind("visual/geometry/mesh"):
            plan.lighten(mesh_file(file, mesh))
        for collision in link.findall("collision"):
            mesh = collision.find("geometry/mesh")
            if mesh is not None and plan.options.collision == "box":
                _make_box(collision, mesh, mesh_file(file, mesh))
            elif mesh is not None:
                own = mesh_file(file, mesh)
                parts = own.with_name(f"{own.stem}_{plan.options.collision}.glb")
                plan.add_parts(plan.inside(parts), own, own)
                mesh.set("filename", os.path.relpath(parts, file.parent))
    plan.texts[plan.inside(file)] = (
        _DECLARATION + ElementTree.tostring(root, encoding="unicode") + "\n"
    )


def _make_box(collision: ElementTree.Element, mesh: ElementTree.Element, file: Path) -> None:
    """Puts a mesh's bounding box in its place."""
    scale = [float(x) for x in mesh.get("scale", "1 1 1").split()]
    center, half = mesh_bounds(file)
    geometry, origin = collision.find("geometry"), collision.find("origin")
    assert geometry is not None
    if origin is None:
        origin = ElementTree.SubElement(collision, "origin", xyz="0 0 0", rpy="0 0 0")
    moved = _turned(origin.get("rpy", "0 0 0"), [s * c for s, c in zip(scale, center, strict=True)])
    place = [float(x) for x in origin.get("xyz", "0 0 0").split()]
    origin.set("xyz", " ".join(f"{p + m:.6g}" for p, m in zip(place, moved, strict=True)))
    geometry.remove(mesh)
    size = " ".join(f"{2 * abs(s) * h:.6g}" for s, h in zip(scale, half, strict=True))
    ElementTree.SubElement(geometry, "box", size=size)


def _turned(rpy: str, vector: list[float]) -> list[float]:
    roll, pitch, yaw = (float(x) for x in rpy.split())
    return (euler2mat(roll, pitch, yaw, "sxyz") @ vector).tolist()


def _mesh(config: Path, name: str | None) -> Path | None:
    """Returns a mesh that a configuration names, None where it is absent."""
    file = (config.parent / name).resolve() if name else None
    return file if file is not None and file.exists() else None


def _mass_kg(template: ObjectTemplate) -> float:
    if template.mass_kg is not None:
        return float(template.mass_kg)
    volumes_m3 = [
        parts_volume(source.file) if source.file else 8.0 * float(np.prod(source.half_size_m))
        for source in template.collision
    ]
    return DEFAULT_DENSITY_KG_M3 * sum(volumes_m3)


def _key(files: list[Path]) -> str:
    """Returns a short hash of several files' bytes."""
    return hashlib.sha256(" ".join(map(content_key, files)).encode()).hexdigest()[:20]
