"""Furniture of a micro-variation with a different pose than in its macro layout (S A.1)."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable

import numpy as np
from scipy.optimize import linear_sum_assignment
from transforms3d.quaternions import qconjugate, qmult

from hab_tasks.geometry import Array, Pose7
from hab_tasks.world.scenes.spec import SceneSpec

MOVED_M = 0.05
TURNED_RAD = math.radians(5.0)


def moved_furniture(macro: SceneSpec, variation: SceneSpec) -> set[str]:
    """Returns the names of the variation's furniture that was moved, rotated or added.

    Pieces of one template are interchangeable: each is matched one to one with the nearest piece of
    the macro layout.
    """
    before, after = _by_template(macro), _by_template(variation)
    moved: set[str] = set()
    for template, pieces in after.items():
        names, poses = zip(*pieces, strict=True)
        old = [pose for _, pose in before.get(template, [])]
        kept: set[int] = set()
        if old:
            distance = np.linalg.norm(_positions(poses)[:, None] - _positions(old), axis=2)
            for new, at in zip(*linear_sum_assignment(distance), strict=True):
                if distance[new, at] <= MOVED_M and _angle(poses[new], old[at]) <= TURNED_RAD:
                    kept.add(int(new))
        moved |= {name for index, name in enumerate(names) if index not in kept}
    return moved


def _by_template(spec: SceneSpec) -> dict[str, list[tuple[str, Pose7]]]:
    found = defaultdict(list)
    for item in spec.objects:
        if not item.dynamic:
            found[item.template.name].append((item.name, item.world_from_object))
    for furniture in spec.articulations:
        found[furniture.template].append((furniture.name, furniture.world_from_root))
    return found


def _positions(poses: Iterable[Pose7]) -> Array:
    return np.array([pose[:3] for pose in poses])


def _angle(a: Pose7, b: Pose7) -> float:
    """Angle [rad] of the rotation from one pose to the other."""
    w = abs(float(qmult(a[3:], qconjugate(b[3:]))[0]))
    return 2 * math.acos(min(w, 1.0))
