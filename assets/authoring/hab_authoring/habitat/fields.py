"""Values in Habitat's episode files: matrices, frames, handles, receptacles, the robot's base."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from transforms3d import quaternions

from hab_tasks.episodes.schema import Base, template_of
from hab_tasks.errors import EpisodeError, UnknownNameError
from hab_tasks.geometry import Array, rotation_between
from hab_tasks.typed_values import number
from hab_tasks.world.scenes.habitat.load import HABITAT_UP
from hab_tasks.world.scenes.meshes import mesh_bounds
from hab_tasks.world.scenes.spec import ObjectTemplate

RIGID = 1e-3
"""Tolerance of rotation matrices; Habitat writes five digits."""


@contextmanager
def naming(where: str, name: str) -> Iterator[None]:
    """Adds episode and field to errors about missing, malformed or unknown values."""
    try:
        yield
    except KeyError as error:
        raise EpisodeError(f"{where}, field {name}: {error} is missing.") from error
    except UnknownNameError as error:
        raise EpisodeError(f"{where}, field {name}: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise EpisodeError(f"{where}, field {name}: malformed ({error}).") from error


def object_frame(template: ObjectTemplate) -> Array:
    """Returns ``habitat_object_from_object`` (4, 4): y up, origin at the centre of the mesh."""
    matrix = np.eye(4)
    turn = rotation_between(np.array(template.up), np.array(HABITAT_UP))
    matrix[:3, :3] = quaternions.quat2mat(turn)
    if template.visual_file is not None:
        center_m, _ = mesh_bounds(template.visual_file)
        matrix[:3, 3] = -matrix[:3, :3] @ np.array(center_m)
    return matrix


def habitat_handles(handles: Iterable[str]) -> dict[str, str]:
    """Returns handle -> Habitat's handle of the object.

    Habitat numbers the instances of each template from 0, in the order of ``rigid_objs``.
    """
    counts: Counter[str] = Counter()
    numbered = {}
    for handle in sorted(handles):
        name = template_of(handle)
        numbered[handle] = f"{name}_:{counts[name]:04d}"
        counts[name] += 1
    return numbered


def close(a: Any, b: Any, tolerance: float) -> bool:
    """Whether two nested values are equal, with a tolerance for numbers."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(close(a[k], b[k], tolerance) for k in a)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(close(x, y, tolerance) for x, y in zip(a, b, strict=True))
    if type(a) in (int, float) and type(b) in (int, float):
        return abs(a - b) <= tolerance
    return bool(a == b)


def body_of(
    entry: dict[str, Any], key: str, index: int, count: int
) -> tuple[str | None, int | None]:
    """Returns a target's body in one of Habitat's lists of receptacles; older files have none."""
    listed = entry.get(key) or []
    if not listed:
        return None, None
    if len(listed) != count:
        raise ValueError(f"{len(listed)} receptacles for {count} targets")
    handle, link_id = listed[index]
    return handle, None if link_id is None else int(link_id)


def target_order(entry: dict[str, Any], goals: dict[str, Any]) -> list[str]:
    """Returns the targets in Habitat's order: by the number in their label, else as listed."""
    labels = (entry.get("info") or {}).get("object_labels") or {}
    numbers = {k: str(v).rpartition("|")[2] for k, v in labels.items() if k in goals}
    if numbers.keys() != goals.keys() or not all(n.isdigit() for n in numbers.values()):
        return list(goals)
    return sorted(goals, key=lambda handle: int(numbers[handle]))


def plain_name(name: Any) -> str:
    """Returns a receptacle's name; newer files write ``object handle|name``."""
    return str(name).rpartition("|")[2]


def read_base(entry: dict[str, Any], where: str) -> Base:
    """Returns the base pose; x points ahead, in Habitat's robots as in ours."""
    with naming(where, "start_position"):
        x, _, z = (number(v) for v in entry.get("start_position", (0, 0, 0)))
    with naming(where, "start_rotation"):
        qx, qy, qz, qw = (number(v) for v in entry.get("start_rotation", (0, 0, 0, 1)))
        if not math.hypot(qx, qy, qz, qw) > 0:
            raise ValueError("a rotation of four zeros")
        ahead = quaternions.quat2mat((qw, qx, qy, qz))[:, 0]
    return x, 0.0 - z, math.atan2(-ahead[2], ahead[0])


def read_matrix(values: Any) -> Array:
    """Returns a rigid (4, 4) transform."""
    matrix = np.asarray(values, dtype=float)
    if matrix.shape != (4, 4):
        raise ValueError(f"a pose needs 4 rows of 4 numbers, found the shape {matrix.shape}")
    turn = matrix[:3, :3]
    off = max(
        np.abs(turn[:, :2].T @ turn[:, :2] - np.eye(2)).max(),
        np.abs(np.cross(turn[:, 0], turn[:, 1]) - turn[:, 2]).max(),
        np.abs(matrix[3] - (0, 0, 0, 1)).max(),
    )
    if not (off < RIGID and np.isfinite(matrix).all()):
        raise ValueError("not a rigid transform (rows of a rotation, translation last)")
    return matrix


def ordered_like(value: Any, model: Any) -> Any:
    """Sorts keys in the order of `model`; the order of targets is significant in Habitat."""
    if not (isinstance(value, dict) and isinstance(model, dict)):
        return value
    keys = [*(k for k in model if k in value), *(k for k in value if k not in model)]
    return {k: ordered_like(value[k], model.get(k)) for k in keys}
