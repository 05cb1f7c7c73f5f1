"""Provenance of episodes, to detect that they are run with other data."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from hab_tasks.errors import EpisodeError
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, embedded_dataset
from hab_tasks.world.scenes.spec import ObjectTemplate

EMBEDDED, YCB = "embedded", "ycb"

logger = logging.getLogger(__name__)


def _is_digest(value: str) -> str:
    return "" if len(value) == 8 else "8 hexadecimal digits"


def _is_kind(value: str) -> str:
    return "" if value in (EMBEDDED, YCB) else f"{EMBEDDED} or {YCB}"


Digest = Annotated[str, _is_digest]


@dataclass(frozen=True, kw_only=True)
class MadeFrom:
    """Provenance of a set of episodes.

    Attributes:
        dataset: The scene dataset's fingerprint, 8 hexadecimal digits.
        objects: The movable objects, `EMBEDDED` or `YCB`.
        masses: Fingerprint of the objects' names and masses.
        generator: Version of the generator; None for episodes from other sources.
    """

    dataset: Digest
    objects: Annotated[str, _is_kind]
    masses: Digest
    generator: int | None


def stable_hash(*names: str) -> int:
    """Returns a hash of names that is equal on every machine and in every run."""
    return zlib.crc32("\0".join(names).encode())


def made_from(
    dataset: SceneDataset, objects: Mapping[str, ObjectTemplate], generator: int | None = None
) -> MadeFrom:
    """Returns the provenance of episodes in `dataset` with `objects` (name -> template)."""
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


def check_made_from(where: str, name: str, given: MadeFrom, now: MadeFrom) -> None:
    """Rejects episodes with other objects; warns if objects or scene dataset have changed.

    `where` is the source of the episodes for messages, `name` their scene dataset and `given` their
    provenance; `now` is that of episodes generated with the same dataset.

    Raises:
        EpisodeError: The objects are of another kind.
    """
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
