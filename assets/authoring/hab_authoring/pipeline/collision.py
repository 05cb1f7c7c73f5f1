"""Convex collision parts of a mesh, by the four methods of S B.1.

A convex decomposition in the dataset is preferred, as it is better than one computed in reasonable
time: CoACD took 30 to 90 s for each of ReplicaCAD's objects and filled more space with more parts.
So `coacd` keeps up to `MAX_PARTS` such parts, merges neighbours if there are more, and runs CoACD
only if there are none. (For YCB's bowl of 70 parts, merging is
better as well: 20 parts of 171 ml in 1 s; CoACD made 20 of 178 to 222 ml in 27 to 190 s.)

A collision mesh whose pieces are not convex, or that does not lie where the visual mesh lies, is no
decomposition. Stages keep what they have: a hull of a room is a block, and the loader's wall boxes
are better than CoACD's parts of a whole flat (hundreds, and twice as thick).
"""

from __future__ import annotations

import heapq
import os
from itertools import combinations, count
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from hab_authoring.pipeline.jobs import AssetOptions
from hab_tasks.errors import DatasetError
from hab_tasks.world.scenes.meshes import read_mesh

MAX_PARTS = 20

CONVEX_SHARE = 0.9
"""Minimum share of their hulls that convex pieces fill."""

MAX_MISFIT = 0.1
"""Maximum difference of the bounds of collision and visual mesh, as a share of the diagonal."""

THINNEST = 1e-3
"""Minimum thickness of a piece as a share of its diagonal, as collisions need a volume."""

APART = 1e-4
"""Shrink share of parts in a file without names; parts that touch would be merged."""

COACD_SETTINGS = {
    "threshold": 0.05,
    "max_convex_hull": MAX_PARTS,
    "preprocess_resolution": 30,
    "resolution": 1000,
    "mcts_iterations": 60,
    "decimate": True,
    "max_ch_vertex": 64,
    "seed": 0,
}
"""Half of CoACD's default effort, which costs a third of the time; 64 corners is PhysX's limit."""

Points = NDArray[np.float64]


def write_parts(own: Path | None, visual: Path, options: AssetOptions, path: Path) -> None:
    """Writes convex parts: named meshes to a GLB, pieces apart from each other to other formats.

    Args:
        own: The collision mesh that the dataset brings.
        visual: The visual mesh, which bounds what is in `own` and is taken where that is no good.
        options: How parts are made, any way but `box`.
        path: The file.

    Raises:
        DatasetError: A mesh is damaged or holds nothing to collide with.
    """
    meshes = None if own is None or options.recompute else _pieces(own)
    if meshes is None or not _fits(meshes, visual):
        own, meshes = None, _pieces(visual)
    source = own or visual
    hulls = [_hull(piece) for piece in meshes]
    if options.collision == "merged-hull":
        hulls = [_hull(np.concatenate(hulls))]
    elif options.collision == "coacd":
        own_will_do = own is not None and _are_convex(meshes, hulls)
        hulls = merge_parts(hulls) if own_will_do else _decompose(source, meshes, hulls)
    parts = [trimesh.convex.convex_hull(points) for points in hulls]
    _write(parts, path)


def merge_parts(parts: list[Points], most: int = MAX_PARTS) -> list[Points]:
    """Merges convex parts greedily by least added volume.

    Args:
        parts: Corners (K, 3) of each part.
        most: Maximum number of parts.

    Returns:
        Corners of each remaining part.
    """
    left = dict(enumerate(parts))
    volume = {number: _volume(points) for number, points in left.items()}
    gains: list[tuple[float, int, int]] = []

    def consider(a: int, b: int) -> None:
        joint = _volume(np.concatenate((left[a], left[b])))
        heapq.heappush(gains, (joint - volume[a] - volume[b], a, b))

    if len(left) > most:
        for a, b in combinations(left, 2):
            consider(a, b)
    numbers = count(len(parts))
    while len(left) > most:
        _, a, b = heapq.heappop(gains)
        if a in left and b in left:
            merged = next(numbers)
            left[merged] = _hull(np.concatenate((left.pop(a), left.pop(b))))
            volume[merged] = _volume(left[merged])
            for other in left:
                if other != merged:
                    consider(merged, other)
    return list(left.values())


def _pieces(file: Path) -> list[trimesh.Trimesh]:
    """Returns the meshes of a scene file or the connected pieces of its single mesh, welded."""
    meshes: list[Any] = read_mesh(file, process=False).dump()
    welded = [trimesh.Trimesh(mesh.vertices, mesh.faces, process=False) for mesh in meshes]
    for mesh in welded:
        mesh.merge_vertices()
    if len(welded) == 1:
        welded = list(welded[0].split(only_watertight=False))
    pieces = [mesh for mesh in welded if len(mesh.vertices) >= 3 and mesh.area > 0]
    if not pieces:
        raise DatasetError(f"{file}: holds no surface to collide with.")
    return pieces


def _fits(pieces: list[trimesh.Trimesh], visual: Path) -> bool:
    """Returns whether a collision mesh lies where the visual mesh lies."""
    own = np.array([piece.bounds for piece in pieces])
    own = np.array([own[:, 0].min(axis=0), own[:, 1].max(axis=0)])
    bounds = read_mesh(visual, process=False).bounds
    return bool(np.abs(own - bounds).max() <= MAX_MISFIT * np.linalg.norm(bounds[1] - bounds[0]))


def _are_convex(pieces: list[trimesh.Trimesh], hulls: list[Points]) -> bool:
    filled = sum(abs(piece.volume) for piece in pieces)
    return bool(filled >= CONVEX_SHARE * sum(map(_volume, hulls)))


def _decompose(source: Path, pieces: list[trimesh.Trimesh], hulls: list[Points]) -> list[Points]:
    """Returns the corners of CoACD's parts of a mesh."""
    if len(pieces) == 1 and _are_convex(pieces, hulls):
        return hulls
    mesh: Any = trimesh.util.concatenate(pieces)
    # Many threads in each of many processes would compete; CoACD reads their number when imported.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), **COACD_SETTINGS)
    if not parts:
        raise DatasetError(f"{source}: CoACD found no convex parts in it.")
    return [_hull(np.asarray(vertices)) for vertices, _ in parts]


def _hull(mesh: trimesh.Trimesh | Points) -> Points:
    """Returns the corners of the convex hull, made thick where it is flat."""
    points = np.asarray(mesh.vertices if isinstance(mesh, trimesh.Trimesh) else mesh, dtype=float)
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=len(points) < 3)[2]
    extent = np.ptp((points - middle) @ axes.T, axis=0)
    least = THINNEST * float(np.linalg.norm(extent))
    for axis in axes[extent < least]:
        points = np.concatenate((points - least / 2 * axis, points + least / 2 * axis))
    try:
        return points[ConvexHull(points).vertices]
    except QhullError as error:
        raise DatasetError(f"a piece with {len(points)} corners has no hull ({error}).") from error


def _volume(points: Points) -> float:
    return float(ConvexHull(points).volume)


def _write(parts: list[trimesh.Trimesh], path: Path) -> None:
    if path.suffix == ".glb":
        scene = trimesh.Scene()
        for index, part in enumerate(parts):
            name = f"part_{index:03d}"
            scene.add_geometry(part, node_name=name, geom_name=name)
        content: Any = scene.export(file_type="glb")
    else:
        for part in parts:
            middle = part.centroid
            part.vertices = middle + (1.0 - APART) * (part.vertices - middle)
        joined: Any = trimesh.util.concatenate(parts)
        content = joined.export(file_type=path.suffix[1:])
    path.write_bytes(content)
