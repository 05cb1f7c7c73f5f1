"""Inner walls, as boxes, of a stage mesh without convex parts.

If the stage mesh is absent, walls are inferred from the published navmeshes: areas that are
walkable in no layout of the stage, and not occupied by furniture in all of them. A staircase is
walkable, but not for a wheeled robot, so it becomes a wall as well. If the mesh is present, walls
are the columns in which it has surface at the height of the robot.

Walls are on a grid of x and z in the y-up stage frame. A layout's furniture is cut out of them, as
published layouts push some furniture into the walls.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage
from trimesh.intersections import slice_faces_plane

from hab_tasks.geometry import Array, apply, inverse
from hab_tasks.io.cache import cached
from hab_tasks.world.scenes.fields import check_numbers, read_fields
from hab_tasks.world.scenes.floor import CELL_M, LOWEST_M, Footprint, footprints, touched
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.navmesh import WALL_HEIGHT_M, Navmesh, read_navmesh
from hab_tasks.world.scenes.meshes import content_key, read_mesh
from hab_tasks.world.scenes.spec import CollisionSource, SceneSpec

NAVMESHES = "navmeshes_default"
"""The published set for the thinnest agent (radius 0.1 m), which shows walls best."""

UNDER_HUNG_M = 1.0
"""Height of walls below wall-mounted furniture."""

SURFACE_M = (0.1, 1.5)
"""Height range in which surface of a mesh counts as wall."""

MARGIN_M = 2 * CELL_M
"""Tolerance beside furniture for Recast's cells and simplified outlines."""

SPARE_M = 0.004
"""Walls keep this distance from furniture, along each axis, where it is not turned."""

MIN_WIDTH_CELLS = 2
MIN_BOX_CELLS = 12
CLOSED_CELLS = 2
"""Gaps up to twice this wide between the surfaces of a mesh are inside a wall."""

_VERSION = 4
Cells = NDArray[np.bool_]
Rectangle = tuple[int, int, int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class WallMap:
    """Walls of a stage mesh.

    Attributes:
        corner_m: Lower corner (2,) of cell (0, 0), x and z.
        shape: Number of cells along x and z.
        blocks: (B, 4) rectangles of wall: first column and row, and the ones after the last.
    """

    corner_m: Array
    shape: tuple[int, int]
    blocks: NDArray[np.int64]


def inner_walls(
    dataset: SceneDataset, spec: SceneSpec, read: Callable[[str], SceneSpec]
) -> tuple[CollisionSource, ...]:
    """Returns the inner walls of a layout in a shell, as boxes in the y-up stage frame.

    They are cached by layout and navmeshes or mesh; `read` reads any layout of the dataset's
    source, in a shell.
    """
    mesh = spec.stage.visual_file
    source = content_key(mesh) if mesh else _navmeshes_key(dataset.source.root / NAVMESHES)
    if source is None:
        return ()

    def write(path: Path) -> None:
        path.write_text(json.dumps(_cut(dataset, spec, read)))

    layout = content_key(dataset.scene_file(spec.scene_id))
    return cached(f"walls/{_VERSION}-{source}-{layout}.json", write, _read_boxes)


def walls_without(
    dataset: SceneDataset, spec: SceneSpec, read: Callable[[str], SceneSpec], moved: Collection[str]
) -> tuple[CollisionSource, ...]:
    """Returns `inner_walls` after some pieces (by name) have been removed."""
    return tuple(_box(*box) for box in _cut(dataset, spec, read, moved))


def _cut(
    dataset: SceneDataset,
    spec: SceneSpec,
    read: Callable[[str], SceneSpec],
    moved: Collection[str] = (),
) -> list[list[float]]:
    """Returns the boxes of a layout's walls, without the furniture `moved`; see `cut`."""
    mesh = spec.stage.visual_file
    walls = _mesh_walls(mesh) if mesh else _stage_walls(dataset.source, spec, read)
    return np.round(cut(walls, furniture_of(spec, moved)), 4).tolist() if len(walls.blocks) else []


def walls_between(
    navmeshes: Sequence[Navmesh], furniture: Sequence[Sequence[Footprint]]
) -> WallMap:
    """Returns the walls that the layouts of one stage have in common.

    Each has a navmesh, all of one size of agent, and furniture.
    """
    bounds = navmeshes[0].bounds
    corner, shape = _grid(np.array(bounds.low)[[0, 2]], np.array(bounds.high)[[0, 2]])
    floor = np.zeros(shape, dtype=bool)
    explained = np.ones_like(floor)
    for navmesh, standing in zip(navmeshes, furniture, strict=True):
        base, step = navmesh.bounds.low[1], navmesh.cell_height_m
        # Heights are whole steps above the lowest point, rounded up; the floor is at y = 0.
        level = base + step * np.ceil(-base / step)
        heights = navmesh.heights(corner + CELL_M / 2, shape, CELL_M)
        floor |= heights < level + step / 2
        heights_m = (LOWEST_M, navmesh.agent_height_m)
        tall = [f.outline_m for f in standing if f.in_the_way(heights_m)]
        explained &= _within(touched(tall, corner, shape), MARGIN_M)
    # Recast took the radius off in whole cells.
    wall = ~_within(floor, navmeshes[0].agent_radius_m + CELL_M / 2) & ~explained
    return _map(corner, wall)


def walls_in_mesh(mesh: trimesh.Trimesh) -> WallMap:
    """Returns the walls of a y-up mesh whose floor is at y = 0."""
    corner, shape = _grid(*mesh.bounds[:, [0, 2]])
    vertices, faces = mesh.vertices, mesh.faces
    for height, side in zip(SURFACE_M, (1.0, -1.0), strict=True):
        vertices, faces, _ = slice_faces_plane(vertices, faces, [0, side, 0], [0, height, 0])
    cells = touched(np.asarray(vertices)[faces][:, :, [0, 2]], corner, shape)
    padded = np.pad(cells, CLOSED_CELLS)
    closed: Any = ndimage.binary_closing(padded, np.ones((3, 3)), iterations=CLOSED_CELLS)
    inner = slice(CLOSED_CELLS, -CLOSED_CELLS)
    return _map(corner, closed[inner, inner])


def cut(walls: WallMap, furniture: Sequence[Footprint]) -> list[tuple[float, ...]]:
    """Cuts furniture out of walls.

    Returns:
        Boxes on the floor: lower x and z, upper x and z, height [m].
    """
    standing = [f.outline_m for f in furniture if f.low_m < UNDER_HUNG_M]
    hung = [f.outline_m for f in furniture if UNDER_HUNG_M <= f.low_m < WALL_HEIGHT_M]
    taken = touched(standing, walls.corner_m, walls.shape, -SPARE_M)
    topped = touched(hung, walls.corner_m, walls.shape, -SPARE_M)
    wall = _drawn(walls) & ~taken
    boxes = []
    for allowed, height in ((wall & ~topped, WALL_HEIGHT_M), (wall & topped, UNDER_HUNG_M)):
        allowed = _opened(allowed)
        left = allowed.copy()
        for block in walls.blocks:
            for a, b, c, d in cover(left, allowed, tuple(block)):
                low, high = (walls.corner_m + CELL_M * np.array(p) for p in ((a, b), (c, d)))
                boxes.append((*low, *high, height))
    return boxes


def cover(left: Cells, allowed: Cells, block: Rectangle) -> list[Rectangle]:
    """Covers marked cells (X, Z) by few rectangles, which may overlap; leaves out slivers.

    Args:
        left: What is to be covered; emptied where it was.
        allowed: Where rectangles may be.
        block: Only cells in this rectangle are to be covered.

    Returns:
        First column and row, and the ones after the last.
    """
    part = left[block[0] : block[2], block[1] : block[3]]
    found = []
    while True:
        a, b, c, d = _largest_rectangle(part)
        if (c - a) * (d - b) < MIN_BOX_CELLS:
            return found
        part[a:c, b:d] = False
        corners = np.array((a, b, c, d)) + np.tile(block[:2], 2)
        a, b, c, d = _grown(allowed, *corners.tolist())
        left[a:c, b:d] = False
        if min(c - a, d - b) >= MIN_WIDTH_CELLS:
            found.append((a, b, c, d))


def furniture_of(spec: SceneSpec, but: Collection[str] = ()) -> list[Footprint]:
    """Returns the shapes of closed furniture, and loose objects, in the y-up stage frame.

    Pieces named in `but` are left out.
    """
    # Geometry needs the engine and its collision library, which a cached layout does without.
    from hab_tasks.world.scenes.layout_geometry import STAGE, Layout

    stage_from_world = inverse(spec.stage.world_from_stage)
    found = []
    for body in Layout.of(spec).placed.values():
        if body.piece not in (STAGE, *but) and len(body.shapes.starts):
            points = apply(stage_from_world, body.points_m.T)[:, [0, 2, 1]].T
            found.extend(footprints(points, body.shapes.starts))
    return found


def _stage_walls(
    dataset: SceneDataset, spec: SceneSpec, read: Callable[[str], SceneSpec]
) -> WallMap:
    """Returns the walls of the layout's stage; none without a navmesh of a layout that uses it."""
    folder, name = dataset.root / NAVMESHES, spec.stage.name

    def write(path: Path) -> None:
        navmeshes = {s: folder / f"{s}.navmesh" for s in dataset.scene_files}
        scenes = [s for s, file in navmeshes.items() if file.exists() and _uses(dataset, s, name)]
        walls = WallMap(corner_m=np.zeros(2), shape=(0, 0), blocks=np.zeros((0, 4), np.int64))
        if scenes:
            furniture = [furniture_of(read(s)) for s in scenes]
            walls = walls_between([read_navmesh(navmeshes[s]) for s in scenes], furniture)
        np.savez(path, corner_m=walls.corner_m, shape=walls.shape, blocks=walls.blocks)

    return cached(f"walls/{_VERSION}-{_navmeshes_key(folder)}-{name}.npz", write, _read_walls)


def _read_boxes(file: Path) -> tuple[CollisionSource, ...]:
    return tuple(_box(*check_numbers(file, "a box", v, 5)) for v in json.loads(file.read_text()))


def _read_walls(file: Path) -> WallMap:
    with np.load(file) as values:
        columns, rows = values["shape"].tolist()
        corner_m, blocks = values["corner_m"], values["blocks"]
    cells = np.array((columns, rows, columns, rows))
    if corner_m.shape != (2,) or not np.isfinite(corner_m).all():
        raise ValueError("a corner that is not finite")
    if blocks.shape[1:] != (4,) or (blocks < 0).any() or (blocks > cells).any():
        raise ValueError("walls outside the map")
    return WallMap(corner_m=corner_m, shape=(columns, rows), blocks=blocks)


def _uses(dataset: SceneDataset, scene_id: str, stage: str) -> bool:
    entry = read_fields(dataset.scene_file(scene_id)).part("stage_instance")
    return Path(entry.text("template_name")).name.removesuffix(".stage_config.json") == stage


@lru_cache(maxsize=8)
def _navmeshes_key(folder: Path) -> str | None:
    """Returns a short hash of all navmeshes in a folder, None without any."""
    files = sorted(folder.glob("*.navmesh"))
    parts = [f"{file.name} {content_key(file)}" for file in files]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:20] if files else None


@lru_cache(maxsize=8)
def _mesh_walls(file: Path) -> WallMap:
    mesh: Any = read_mesh(file).to_mesh()
    return walls_in_mesh(mesh)


def _box(low_x: float, low_z: float, high_x: float, high_z: float, height: float) -> Any:
    return CollisionSource(
        kind="box",
        center_m=((low_x + high_x) / 2, height / 2, (low_z + high_z) / 2),
        half_size_m=((high_x - low_x) / 2, height / 2, (high_z - low_z) / 2),
    )


def _grid(low: Array, high: Array) -> tuple[Array, tuple[int, int]]:
    """Returns corner and shape of the grid between two corners (2,)."""
    columns, rows = (int(n) for n in np.ceil((high - low) / CELL_M))
    return low, (columns, rows)


def _map(corner_m: Array, cells: Cells) -> WallMap:
    cells = _opened(cells)
    whole = (0, 0, *cells.shape)
    blocks = np.array(cover(cells.copy(), cells, whole), dtype=np.int64).reshape(-1, 4)
    return WallMap(corner_m=corner_m, shape=cells.shape, blocks=blocks)


def _drawn(walls: WallMap) -> Cells:
    cells = np.zeros(walls.shape, dtype=bool)
    for a, b, c, d in walls.blocks:
        cells[a:c, b:d] = True
    return cells


def _within(cells: Cells, distance_m: float) -> Cells:
    """Marks the cells whose middle is so near to the middle of a marked one."""
    if not cells.any():
        return np.zeros_like(cells)
    distance: Any = ndimage.distance_transform_edt(~cells)
    return CELL_M * distance <= distance_m + 1e-9


def _opened(cells: Cells) -> Cells:
    """Removes what is narrower than `MIN_WIDTH_CELLS`."""
    opened: Any = ndimage.binary_opening(cells, np.ones((MIN_WIDTH_CELLS, MIN_WIDTH_CELLS)))
    return opened


def _largest_rectangle(cells: Cells) -> Rectangle:
    """Returns the largest rectangle of marked cells."""
    best, area = (0, 0, 0, 0), 0
    depths = np.zeros(cells.shape[1] + 1, dtype=np.int64)
    for column in range(cells.shape[0]):
        depths[:-1] = np.where(cells[column], depths[:-1] + 1, 0)
        if depths.sum() <= area:
            continue
        for first, last, depth in _spans(depths.tolist()):
            if depth * (last - first) > area:
                area = depth * (last - first)
                best = (column + 1 - depth, first, column + 1, last)
    return best


def _spans(depths: Iterable[int]) -> Iterator[tuple[int, int, int]]:
    """Yields every widest run (first, after last, depth) of a histogram that ends with 0."""
    open_runs: list[tuple[int, int]] = []
    for at, depth in enumerate(depths):
        first = at
        while open_runs and open_runs[-1][1] >= depth:
            first, deeper = open_runs.pop()
            yield first, at, deeper
        open_runs.append((first, depth))


def _grown(cells: Cells, a: int, b: int, c: int, d: int) -> Rectangle:
    """Extends a rectangle to all sides as far as marked cells go."""
    while a > 0 and cells[a - 1, b:d].all():
        a -= 1
    while c < cells.shape[0] and cells[c, b:d].all():
        c += 1
    while b > 0 and cells[a:c, b - 1].all():
        b -= 1
    while d < cells.shape[1] and cells[a:c, d].all():
        d += 1
    return a, b, c, d
