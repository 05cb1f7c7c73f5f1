"""What episodes were made from, so that they are not played in something else."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hab_tasks.errors import EpisodeError
from hab_tasks.scenes.dataset import SceneDataset, embedded_dataset
from hab_tasks.scenes.spec import ObjectTemplate

EMBEDDED, YCB = "embedded", "ycb"

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class MadeFrom:
    """What episodes were made from.

    Attributes:
        dataset: The scene dataset's fingerprint, 8 hexadecimal digits.
        objects: `EMBEDDED` or `YCB`: which movable objects.
        masses: The same for the objects' names and masses.
        generator: Version of the generator; None for episodes that come from elsewhere.
    """

    dataset: str
    objects: str
    masses: str
    generator: int | None


def stable_hash(*names: str) -> int:
    """Returns a number made from names, the same on every machine and in every run."""
    return zlib.crc32("\0".join(names).encode())


def made_from(
    dataset: SceneDataset, objects: Mapping[str, ObjectTemplate], generator: int | None = None
) -> MadeFrom:
    """Returns what episodes in `dataset` with `objects` (name -> template) are made from."""
    files = (template.visual_file for template in objects.values())
    ours = embedded_dataset().resolve()
    embedded = all(file is not None and file.is_relative_to(ours) for file in files)
    masses = (f"{name} {template.mass_kg}" for name, template in sorted(objects.items()))
    return MadeFrom(
        dataset=f"{dataset.fingerprint:08x}",
        objects=EMBEDDED if embedded else YCB,
        masses=f"{stable_hash(*masses):08x}",
        generator=generator,
    )


def read_made_from(raw: Any) -> MadeFrom:
    """Returns what a file says. Raises TypeError or ValueError when it makes no sense."""
    found = MadeFrom(**raw)
    digests = (found.dataset, found.masses)
    if not all(isinstance(digest, str) and len(digest) == 8 for digest in digests):
        raise ValueError("dataset and masses need 8 hexadecimal digits")
    if found.objects not in (EMBEDDED, YCB):
        raise ValueError(f"objects {found.objects!r} instead of {EMBEDDED} or {YCB}")
    if found.generator is not None and not isinstance(found.generator, int):
        raise ValueError(f"generator {found.generator!r} is no version")
    return found


def check_made_from(
    where: str, name: str, given: MadeFrom, dataset: SceneDataset, now: MadeFrom
) -> None:
    """Refuses episodes of another dataset or with other objects; warns when these have changed.

    Args:
        where: File and what else leads to the episodes, for messages.
        name: The scene dataset that they are for.
        given: What they were made from.
        dataset: Where they are to be played.
        now: What episodes made there would be made from.

    Raises:
        EpisodeError: The scene dataset has another name, or the objects are of another kind.
    """
    if name != dataset.name:
        raise EpisodeError(
            f"{where}: made for the scene dataset {name}, and this one is {dataset.name}. Give the "
            f"folder of {name} as scene dataset (--scene-dataset, scene_dataset=)."
        )
    if given.objects != now.objects:
        wanted = "the path of the YCB folder" if given.objects == YCB else "nothing"
        raise EpisodeError(
            f"{where}: made with the {given.objects} objects, and these are the {now.objects} "
            f"ones. Give {wanted} for the objects (--objects, objects=)."
        )
    changed = [
        what
        for what, before, after in (
            (f"the scene dataset {name}", given.dataset, now.dataset),
            (f"the {now.objects} objects", given.masses, now.masses),
        )
        if before != after
    ]
    if changed:
        logger.warning(
            "%s: %s changed since these episodes were made; they may not start as they did then.",
            where,
            " and ".join(changed) + (" have" if len(changed) > 1 else " has"),
        )
