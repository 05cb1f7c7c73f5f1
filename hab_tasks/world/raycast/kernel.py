"""Nearest surface along each pixel's ray, compiled by numba.

A ray is cast through the centre of every pixel. Instead of searching the triangles of each ray, the
kernel searches the rays of each triangle: it projects the triangle and visits the pixels whose
centre it covers. The inverse depth of a plane is linear in the image, so the depth at these pixels
is that of the ray's exact intersection. As in the renderer, back faces are invisible and surfaces
outside the near and far plane are cut off.

Camera frame: x right, y down, z forward (OpenCV). Import this module through
`hab_tasks.world.raycast.compiled`, which chooses numba's cache folder.
"""

from __future__ import annotations

from math import ceil, floor, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

CLUSTER_FACES = 128
"""Maximum number of triangles of a cluster."""

SHORT_ROW_PX = 4
"""Vectorised loops do not pay for shorter rows."""

# Without numba's counts of references, which take longer than the work on a small triangle, as do
# calls, which pass arrays as many values.
_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "_nrt": False}
_inlined = njit(**_OPTIONS, forceinline=True)


class Surfaces(NamedTuple):
    """Triangle meshes of all surfaces, each split into clusters.

    Attributes:
        vertices_m: (3, V) float32 in the body's frame, grouped by cluster.
        faces: (F, 3) int32, grouped by cluster; indices count from the cluster's first vertex.
        clusters: (C, 5) int32: first vertex, number of vertices, first face, number of faces,
            whether the backs of its faces are visible.
        spheres_m: (C, 4) float32: centre and radius of each cluster's bounding sphere.
        ranges: (S, 2) int32: first cluster of each surface and the one after its last.
        bounds_m: (S, 4) float32: centre and radius of each surface's bounding sphere.
    """

    vertices_m: NDArray[np.float32]
    faces: NDArray[np.int32]
    clusters: NDArray[np.int32]
    spheres_m: NDArray[np.float32]
    ranges: NDArray[np.int32]
    bounds_m: NDArray[np.float32]


class Lens(NamedTuple):
    """Pinhole camera.

    Attributes:
        fx_px: Focal length along the image's width.
        fy_px: Focal length along the image's height.
        cx_px: Principal point, from the left edge.
        cy_px: Principal point, from the top edge.
        near_m: Depth of the near plane.
        far_m: Depth of the far plane.
        slope_x: Largest |x| / z in view.
        slope_y: Largest |y| / z in view.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    near_m: float
    far_m: float
    slope_x: float
    slope_y: float


@njit(cache=True, nogil=True, error_model="numpy")
def cast(
    surfaces: Surfaces,
    instances: NDArray[np.int32],
    camera_from_body: NDArray[np.float32],
    lens: Lens,
    inverse_depth: NDArray[np.float32],
    actors: NDArray[np.int16],
) -> None:
    """Writes the nearest surface of each pixel.

    Args:
        surfaces: All surfaces.
        instances: (B, 2) surface of each body and the actor number of the body.
        camera_from_body: (B, 3, 4) poses.
        lens: The camera.
        inverse_depth: (H, W) [1/m], filled with the inverse of the far plane's depth.
        actors: (H, W) filled with 0, or (0, 0) if actor numbers are not needed.
    """
    corners = np.empty((6, 3 * CLUSTER_FACES), dtype=np.float32)
    shape = np.empty((4, 3))
    _cast(surfaces, instances, camera_from_body, lens, inverse_depth, actors, corners, shape)


@njit(**_OPTIONS)
def _cast(
    surfaces: Any, instances: Any, poses: Any, lens: Any, inverse_depth: Any, actors: Any,
    corners: Any, shape: Any,
) -> None:  # fmt: skip
    """As `cast`; `corners` and `shape` are scratch."""
    for body in range(len(instances)):
        surface, actor = instances[body]
        pose = poses[body]
        if not _in_view(surfaces.bounds_m[surface], pose, lens):
            continue
        for cluster in range(surfaces.ranges[surface, 0], surfaces.ranges[surface, 1]):
            sphere = surfaces.spheres_m[cluster]
            if not _in_view(sphere, pose, lens):
                continue
            first, count, first_face, faces, two_sided = surfaces.clusters[cluster]
            _project(surfaces.vertices_m[:, first : first + count], pose, lens, corners)
            chosen = surfaces.faces[first_face : first_face + faces]
            if _depth(sphere, pose) - sphere[3] < lens.near_m:
                _draw_clipped(chosen, corners, lens, two_sided, inverse_depth, actors, actor, shape)
            else:
                _draw(chosen, corners, two_sided, inverse_depth, actors, actor)


@_inlined
def _depth(point: Any, pose: Any) -> float:
    """Returns the depth [m] of a point in the body's frame."""
    return pose[2, 0] * point[0] + pose[2, 1] * point[1] + pose[2, 2] * point[2] + pose[2, 3]


@_inlined
def _in_view(sphere: Any, pose: Any, lens: Any) -> bool:
    """Returns whether a sphere (4,) in the body's frame may be in view."""
    radius = sphere[3]
    z = _depth(sphere, pose)
    if z + radius < lens.near_m or z - radius > lens.far_m:
        return False
    x = pose[0, 0] * sphere[0] + pose[0, 1] * sphere[1] + pose[0, 2] * sphere[2] + pose[0, 3]
    y = pose[1, 0] * sphere[0] + pose[1, 1] * sphere[1] + pose[1, 2] * sphere[2] + pose[1, 3]
    if abs(x) - lens.slope_x * z > radius * sqrt(1.0 + lens.slope_x**2):
        return False
    return abs(y) - lens.slope_y * z <= radius * sqrt(1.0 + lens.slope_y**2)


@_inlined
def _project(points_m: Any, pose: Any, lens: Any, corners: Any) -> None:
    """Writes image position [px], inverse depth [1/m] and camera position [m] of points (3, P)."""
    fx_px, fy_px = np.float32(lens.fx_px), np.float32(lens.fy_px)
    cx_px, cy_px = np.float32(lens.cx_px), np.float32(lens.cy_px)
    # Numbers instead of array elements, which could change with `corners`: the loop is vectorised.
    xa, xb, xc, xd = pose[0, 0], pose[0, 1], pose[0, 2], pose[0, 3]
    ya, yb, yc, yd = pose[1, 0], pose[1, 1], pose[1, 2], pose[1, 3]
    za, zb, zc, zd = pose[2, 0], pose[2, 1], pose[2, 2], pose[2, 3]
    for i in range(points_m.shape[1]):
        a, b, c = points_m[0, i], points_m[1, i], points_m[2, i]
        x = xa * a + xb * b + xc * c + xd
        y = ya * a + yb * b + yc * c + yd
        z = za * a + zb * b + zc * c + zd
        inverse = np.float32(1.0) / z
        corners[0, i] = fx_px * x * inverse + cx_px
        corners[1, i] = fy_px * y * inverse + cy_px
        corners[2, i] = inverse
        corners[3, i], corners[4, i], corners[5, i] = x, y, z


@_inlined
def _corner(corners: Any, i: int) -> tuple[float, float, float]:
    """Returns image position [px] and inverse depth [1/m] of a vertex."""
    return float(corners[0, i]), float(corners[1, i]), float(corners[2, i])


@_inlined
def _draw(
    faces: Any, corners: Any, two_sided: int, inverse_depth: Any, actors: Any, actor: int
) -> None:
    """Draws the visible faces of a cluster."""
    for face in range(len(faces)):
        a = _corner(corners, faces[face, 0])
        b = _corner(corners, faces[face, 1])
        c = _corner(corners, faces[face, 2])
        _draw_triangle(a, b, c, two_sided, inverse_depth, actors, actor)


@_inlined
def _draw_clipped(
    faces: Any, corners: Any, lens: Any, two_sided: int, inverse_depth: Any, actors: Any,
    actor: int, shape: Any,
) -> None:  # fmt: skip
    """Draws the visible faces of a cluster, cut off at the near plane; `shape` is scratch."""
    for face in range(len(faces)):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        if min(corners[5, i], corners[5, j], corners[5, k]) >= lens.near_m:
            a, b, c = _corner(corners, i), _corner(corners, j), _corner(corners, k)
            _draw_triangle(a, b, c, two_sided, inverse_depth, actors, actor)
            continue
        size = _clip(faces[face], corners, lens, shape)
        a = (shape[0, 0], shape[0, 1], shape[0, 2])
        for last in range(2, size):
            b = (shape[last - 1, 0], shape[last - 1, 1], shape[last - 1, 2])
            c = (shape[last, 0], shape[last, 1], shape[last, 2])
            _draw_triangle(a, b, c, two_sided, inverse_depth, actors, actor)


@_inlined
def _clip(face: Any, corners: Any, lens: Any, shape: Any) -> int:
    """Cuts a triangle off at the near plane; returns the number of corners written to `shape`."""
    size = 0
    for edge in range(3):
        i, j = face[edge], face[(edge + 1) % 3]
        before, after = corners[5, i] >= lens.near_m, corners[5, j] >= lens.near_m
        if before:
            for axis in range(3):
                shape[size, axis] = corners[axis, i]
            size += 1
        if before != after:
            part = (lens.near_m - corners[5, i]) / (corners[5, j] - corners[5, i])
            x = corners[3, i] + part * (corners[3, j] - corners[3, i])
            y = corners[4, i] + part * (corners[4, j] - corners[4, i])
            shape[size, 0] = lens.fx_px * x / lens.near_m + lens.cx_px
            shape[size, 1] = lens.fy_px * y / lens.near_m + lens.cy_px
            shape[size, 2] = 1.0 / lens.near_m
            size += 1
    return size


@_inlined
def _draw_triangle(
    a: Any, b: Any, c: Any, two_sided: int, inverse_depth: Any, actors: Any, actor: int
) -> None:
    """Draws a triangle with corners (x [px], y [px], inverse depth [1/m]) if it is visible."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    # Anticlockwise seen from outside is a negative area here, where y is down.
    if area == 0.0 or (area > 0.0 and not two_sided):
        return
    height, width = inverse_depth.shape
    # Pixel centres are at half pixels; most triangles of distant meshes cover none.
    top = ceil(max(min(a[1], b[1], c[1]) - 0.5, 0.0))
    bottom = floor(min(max(a[1], b[1], c[1]) - 0.5, height - 1.0))
    left = float(ceil(max(min(a[0], b[0], c[0]) - 0.5, 0.0)))
    right = float(floor(min(max(a[0], b[0], c[0]) - 0.5, width - 1.0)))
    if bottom < top or right < left:
        return
    per_x = ((b[2] - a[2]) * (c[1] - a[1]) - (c[2] - a[2]) * (b[1] - a[1])) / area
    per_y = ((c[2] - a[2]) * (b[0] - a[0]) - (b[2] - a[2]) * (c[0] - a[0])) / area
    origin = a[2] + per_x * (0.5 - a[0]) + per_y * (0.5 - a[1])
    # Rounding on slivers must not bring a surface nearer than its nearest corner.
    nearest = np.float32(max(a[2], b[2], c[2]))
    if b[1] < a[1]:
        a, b = b, a
    if c[1] < a[1]:
        a, c = c, a
    if c[1] < b[1]:
        b, c = c, b
    long, upper, lower = _slope(a, c), _slope(a, b), _slope(b, c)
    for row in range(top, bottom + 1):
        y = row + 0.5
        one = a[0] + (y - a[1]) * long
        other = a[0] + (y - a[1]) * upper if y < b[1] else b[0] + (y - b[1]) * lower
        first = ceil(max(min(one, other) - 0.5, left))
        last = floor(min(max(one, other) - 0.5, right))
        start = np.float32(origin + per_y * row + per_x * first)
        if last >= first:
            _fill(inverse_depth, actors, actor, row, first, last, start, per_x, nearest)


@_inlined
def _slope(upper: Any, lower: Any) -> float:
    """Returns the change of x along y between two points, 0 on a horizontal edge."""
    rise = lower[1] - upper[1]
    return (lower[0] - upper[0]) / rise if rise > 0.0 else 0.0


@_inlined
def _fill(
    inverse_depth: Any,
    actors: Any,
    actor: int,
    row: int,
    first: int,
    last: int,
    start: Any,
    per_x: float,
    nearest: Any,
) -> None:
    """Writes the pixels of a row between two columns where the surface is the nearest so far."""
    step = np.float32(per_x)
    if actors.size == 0:
        if last - first < SHORT_ROW_PX:
            for column in range(first, last + 1):
                value = min(start + step * np.float32(column - first), nearest)
                if value > inverse_depth[row, column]:
                    inverse_depth[row, column] = value
            return
        # Without branches, so that the compiler vectorises it.
        pixels = inverse_depth[row, first : last + 1]
        for i in range(len(pixels)):
            pixels[i] = max(pixels[i], min(start + step * np.float32(i), nearest))
        return
    for column in range(first, last + 1):
        value = min(start + step * np.float32(column - first), nearest)
        if value > inverse_depth[row, column]:
            inverse_depth[row, column] = value
            actors[row, column] = actor
