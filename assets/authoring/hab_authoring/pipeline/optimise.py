"""An optimised copy of a dataset (S B.1): light visuals, convex parts, the same format and names.

The copy has the dataset's folder layout. Configurations are copied and point at the new collision
parts; masses, friction, receptacles, scenes, navmeshes, lights and licence files are copied.
Results are kept in the cache, keyed by content and options, so that a second run computes nothing.
The source is never written to, and a run that is stopped leaves no half copy.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path

from hab_authoring.pipeline.footprint import Footprint, footprint
from hab_authoring.pipeline.jobs import Progress, Tally, run_jobs
from hab_authoring.pipeline.options import AssetOptions
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
