"""Rays against triangles: the kernel equals a search over all triangles."""

import numpy as np
import sapien

from hab_tasks.world.raycast.compiled import kernel
from hab_tasks.world.raycast.library import Mesh, in_clusters, mesh_of
from hab_tasks.world.raycast.scene import Pinhole, cv_from_world
from hab_tasks.world.scenes.visuals import Visual

WIDTH_PX, HEIGHT_PX, FOCAL_PX, NEAR_M, FAR_M = 40, 24, 20.0, 0.5, 6.0
ACTOR = 7
CAMERA = Pinhole(
    width_px=WIDTH_PX,
    height_px=HEIGHT_PX,
    focal_px=(FOCAL_PX, FOCAL_PX),
    centre_px=(WIDTH_PX / 2, HEIGHT_PX / 2),
    near_m=NEAR_M,
    far_m=FAR_M,
)


def cast(mesh):
    """Casts rays at a mesh in the camera's frame; returns depth [m] and actors (H, W)."""
    clusters = in_clusters(mesh, kernel().CLUSTER_FACES)
    surfaces = kernel().Surfaces(
        vertices_m=np.ascontiguousarray(clusters.vertices_m.T),
        faces=clusters.faces,
        clusters=clusters.clusters,
        spheres_m=clusters.spheres_m,
        ranges=np.array([[0, len(clusters.clusters)]], dtype=np.int32),
        bounds_m=clusters.bound_m[None],
    )
    beyond = np.float32(1.0 / FAR_M)
    inverse = np.full((HEIGHT_PX, WIDTH_PX), beyond)
    actors = np.zeros(inverse.shape, dtype=np.int16)
    pose = np.eye(4, dtype=np.float32)[None, :3]
    instance = np.array([[0, ACTOR]], dtype=np.int32)
    kernel().cast(surfaces, instance, pose, CAMERA.lens, inverse, actors)
    return np.where(inverse > beyond, 1.0 / inverse, 0.0), actors


def searched(mesh):
    """Returns depth (H, W) by intersecting every ray with every triangle (Moeller-Trumbore), and
    where rays pass so near to an edge that rounding decides."""
    x = (np.arange(WIDTH_PX) + 0.5 - WIDTH_PX / 2) / FOCAL_PX
    y = (np.arange(HEIGHT_PX) + 0.5 - HEIGHT_PX / 2) / FOCAL_PX
    rays = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)[:, :, None]
    a, b, c = (mesh.vertices_m.astype(float)[mesh.faces[:, i]] for i in range(3))
    across = np.cross(rays, c - a)
    facing = np.einsum("fi,hwfi->hwf", b - a, across)
    u = np.einsum("fi,hwfi->hwf", -a, across) / facing
    q = np.cross(-a, b - a)
    v = (rays * q).sum(axis=-1) / facing
    depth = np.einsum("fi,fi->f", c - a, q) / facing
    least = np.minimum(np.minimum(u, v), 1.0 - u - v)
    seen = ((facing > 0) | mesh.two_sided) & (depth >= NEAR_M) & (depth < FAR_M)
    hits = np.where(seen & (least >= 0), depth, np.inf).min(axis=2)
    unsure = (np.abs(least) < 1e-3) | (np.abs(depth - NEAR_M) < 1e-3)
    return np.where(np.isinf(hits), 0.0, hits), unsure.any(axis=2)


def soup(seed, count=60):
    """Random triangles, many across the near plane, behind the camera or beyond the far plane."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform((-4, -3, -2), (4, 3, 8), (count, 1, 3))
    corners = (middles + rng.normal(0, 0.7, (count, 3, 3))).reshape(-1, 3).astype(np.float32)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Mesh(corners, faces, rng.uniform(size=count) < 0.5)


def test_rays_hit_the_nearest_visible_triangle():
    # The last has more triangles than a cluster takes, of both kinds.
    for mesh in (soup(0), soup(1), soup(9, count=400)):
        depth_m, actors = cast(mesh)
        expected_m, unsure = searched(mesh)
        sure = ~unsure
        assert sure.mean() > 0.5
        assert np.abs(depth_m - expected_m)[sure].max() < 2e-5
        assert ((actors == ACTOR) == (depth_m > 0))[sure].all()
        assert 0.1 < (depth_m > 0).mean() < 1.0


def test_a_floor_is_cut_off_at_the_near_and_the_far_plane():
    """A plane 1 m below the camera, from 5 m behind it to 50 m ahead: depth is 1 / slope."""
    corners = np.array([[-99, 1, -5], [99, 1, -5], [99, 1, 50], [-99, 1, 50]], dtype=np.float32)
    up = np.array([[1, 2, 0], [2, 3, 0]], dtype=np.int32)  # visible from above
    below_px = np.arange(HEIGHT_PX) + 0.5 - HEIGHT_PX / 2
    with np.errstate(divide="ignore"):
        expected_m = FOCAL_PX / below_px
    expected_m[(below_px <= 0) | (expected_m < NEAR_M) | (expected_m >= FAR_M)] = 0.0
    one_sided, two_sided = np.zeros(2, dtype=bool), np.ones(2, dtype=bool)
    for faces, sides in ((up, one_sided), (up[:, ::-1], two_sided)):
        assert np.abs(cast(Mesh(corners, faces, sides))[0] - expected_m[:, None]).max() < 1e-4
    assert not cast(Mesh(corners, up[:, ::-1], one_sided))[0].any(), "seen from behind"


def test_primitives_have_their_size_and_face_outwards():
    for kind, size, half_m in (
        ("box", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
        ("sphere", (0.2,), (0.2, 0.2, 0.2)),
        ("cylinder", (0.1, 0.3), (0.1, 0.1, 0.3)),
        ("capsule", (0.1, 0.3), (0.1, 0.1, 0.4)),
    ):
        mesh = mesh_of((Visual(kind=kind, size=size),))
        assert np.allclose(np.abs(mesh.vertices_m).max(axis=0), half_m, atol=2e-3), kind
        a, b, c = (mesh.vertices_m[mesh.faces[:, i]] for i in range(3))
        assert np.einsum("fi,fi->", a, np.cross(b, c)) > 0, kind  # six times the volume


def test_a_camera_looks_along_its_x_axis():
    pose = sapien.Pose([1.0, 2.0, 3.0], [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # to world y
    ahead = cv_from_world(pose) @ (1.0, 4.0, 3.5, 1.0)
    assert np.allclose(ahead, (0.0, -0.5, 2.0, 1.0), atol=1e-6)
