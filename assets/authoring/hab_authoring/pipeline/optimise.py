"""An optimised copy of a dataset (S B.1): light visuals, convex parts, the same format and names.

The copy has the dataset's folder layout. Configurations are copied and point at the new collision
parts; masses, friction, receptacles, scenes, navmeshes, lights and licence files are copied.
Results are kept in the cache, keyed by content and options, so that a second run computes nothing.
The source is never written to, and a run that is stopped leaves no half copy.
"""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from hab_authoring.pipeline.glb import Glb, read_glb
from hab_authoring.pipeline.jobs import AssetOptions, Progress, Tally, run_jobs
from hab_authoring.pipeline.plan import CopyPlan, plan_dataset, plan_objects
from hab_tasks.errors import HabError, UnknownNameError
from hab_tasks.io.files import check_folder, folder_written_aside
from hab_tasks.option_values import MOST_WORKERS, whole
from hab_tasks.world.scenes.habitat.dataset import SceneDataset

OBJECTS_FOLDER = "ycb"
"""Folder of the YCB copy in the copy of the dataset."""

NOTE = "hab_tasks_assets.json"
"""File in the copy that lists the changes, as licences require."""

CHANGES = (
    "Visual meshes have fewer triangles and smaller, compressed textures; collision meshes are "
    "convex parts computed from the originals; numbers in URDFs are separated by blanks."
)


@dataclass(frozen=True, kw_only=True)
class Report:
    """Result of a run.

    Attributes:
        out: The copy.
        tally: Numbers of computed and cached results.
        before: Sizes of the dataset's GLB visuals.
        after: Sizes of the copy's.
    """

    out: Path
    tally: Tally
    before: Footprint
    after: Footprint


def optimise(
    dataset: SceneDataset,
    out: Path,
    options: AssetOptions,
    *,
    objects: Path | None = None,
    workers: int = 1,
    force: bool = False,
    progress: Progress = lambda done, count: None,
) -> Report:
    """Writes an optimised copy of a dataset, and of a YCB folder into `OBJECTS_FOLDER` in it.

    Args:
        dataset: The source.
        out: The copy; written atomically.
        options: How it is optimised.
        objects: A YCB folder to copy as well.
        workers: Number of processes.
        force: Whether a dataset at `out` may be replaced.
        progress: Called after every computation.

    Raises:
        HabError: Bad options, or `out` may not be written to.
        DatasetError: A file of the dataset is damaged.
    """
    whole("--workers", workers, 1, MOST_WORKERS)
    _check_sources(dataset, objects)
    check_folder(out.expanduser(), force=force, mark=NOTE)
    out = out.expanduser().resolve()
    ycb = objects.expanduser().resolve() if objects is not None else None
    for source in (dataset.root, ycb):
        _keep_apart(out, source)
    plans = {Path(): plan_dataset(dataset, options)}
    if ycb is not None:
        plans[Path(OBJECTS_FOLDER)] = plan_objects(ycb, options)
    jobs = [job for plan in plans.values() for job in plan.jobs.values()]
    tally = run_jobs(jobs, workers, progress)
    note = {"copied from": dataset.name, "changes": CHANGES, "options": asdict(options)}
    with folder_written_aside(out) as copy:
        for folder, plan in plans.items():
            _assemble(plan, copy / folder)
        (copy / NOTE).write_text(json.dumps(note, indent=2) + "\n")
    visuals = plans[Path()].visuals
    return Report(
        out=out,
        tally=tally,
        before=footprint(dataset.root / target for target in visuals),
        after=footprint(out / target for target in visuals),
    )


def _check_sources(dataset: SceneDataset, objects: Path | None) -> None:
    if objects is not None and not objects.expanduser().is_dir():
        raise UnknownNameError("objects", str(objects), ["PATH of a YCB folder"])
    if dataset.layouts is not None:
        raise HabError(
            f"{dataset.root} holds layouts only; copy {dataset.layouts.dataset}, and name the copy "
            "in its layouts.json."
        )


def _keep_apart(out: Path, source: Path | None) -> None:
    if source is not None and out.is_relative_to(source):
        raise HabError(f"--out {out}: lies in {source}, which is never written to.")
    if source is not None and source.is_relative_to(out):
        raise HabError(f"--out {out}: holds {source}, which is never replaced.")


def _assemble(plan: CopyPlan, folder: Path) -> None:
    files = {target: plan.root / target for target in plan.copied()}
    for target, job in plan.jobs.items():
        made = job.result
        made_files = sorted(made.iterdir()) if made.is_dir() else [made]
        for file in made_files:
            files[target / file.name if made.is_dir() else target] = file
    for target, file in files.items():
        (folder / target).parent.mkdir(parents=True, exist_ok=True)
        # Not the permissions: a source may be read-only.
        shutil.copyfile(file, folder / target)
    for target, text in plan.texts.items():
        (folder / target).parent.mkdir(parents=True, exist_ok=True)
        (folder / target).write_text(text)


VERTEX_BYTES = 56
"""Position, normal, tangent and bitangent of three floats, texture coordinate of two."""

INDEX_BYTES = 4
PIXEL_BYTES = 4
"""Images of any format become RGBA."""

_KTX2_LEVEL_LENGTH_AT = 88


@dataclass(frozen=True, kw_only=True)
class Footprint:
    """Sizes of one or more meshes."""

    triangles: int = 0
    mesh_bytes: int = 0
    texture_bytes: int = 0

    def __add__(self, other: Footprint) -> Footprint:
        """Returns the summed sizes."""
        return Footprint(
            triangles=self.triangles + other.triangles,
            mesh_bytes=self.mesh_bytes + other.mesh_bytes,
            texture_bytes=self.texture_bytes + other.texture_bytes,
        )

    @property
    def total_bytes(self) -> int:
        """Meshes and textures."""
        return self.mesh_bytes + self.texture_bytes


def footprint(files: Iterable[Path]) -> Footprint:
    """Returns the sizes of GLB files, each loaded once.

    Raises:
        DatasetError: A file is damaged.
    """
    return sum(map(_of_file, files), Footprint())


def _of_file(file: Path) -> Footprint:
    glb = read_glb(file)
    document = glb.document
    corners = vertices = 0
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            points = document["accessors"][primitive["attributes"]["POSITION"]]["count"]
            vertices += points
            has_indices = "indices" in primitive
            corners += (
                document["accessors"][primitive["indices"]]["count"] if has_indices else points
            )
    return Footprint(
        triangles=corners // 3,
        mesh_bytes=VERTEX_BYTES * vertices + INDEX_BYTES * corners,
        texture_bytes=sum(_image_bytes(glb, number) for number in _images(document)),
    )


def _images(document: dict[str, Any]) -> set[int]:
    """Returns the numbers of the images that SAPIEN loads."""
    shown = set()
    for texture in document.get("textures", []):
        extension = texture.get("extensions", {}).get("KHR_texture_basisu", {})
        shown.add(extension.get("source", texture.get("source")))
    return shown - {None}


def _image_bytes(glb: Glb, number: int) -> int:
    entry = glb.document["images"][number]
    if "bufferView" not in entry:
        return 0
    content = glb.views[entry["bufferView"]]
    if entry.get("mimeType") == "image/ktx2":
        return struct.unpack_from("<Q", content, _KTX2_LEVEL_LENGTH_AT)[0]
    with Image.open(BytesIO(content)) as image:
        return PIXEL_BYTES * image.width * image.height
