"""Templates of the embedded dataset: surfaces support objects, and joints move freely."""

from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from apartment_solids import (
    ROOT,
    collision_of,
    deepest,
    depth,
    jointed,
    load,
    numbers,
    object_config,
    origin_of,
    part,
    receptacles,
    solid_of,
)

OBJECTS = sorted(p.name.split(".")[0] for p in (ROOT / "configs/objects").glob("*.json"))
ARTICULATIONS = sorted(p.parent.name for p in ROOT.rglob("*.urdf"))


def supports() -> list:
    """Every receptacle with the solids of the object or link it belongs to."""
    found = []
    for name in OBJECTS:
        path, config = object_config(name)
        meshes = collision_of(path, config)
        found += [(r, meshes) for r in receptacles(config)]
    for path in sorted(ROOT.rglob("*.ao_config.json")):
        robot = ElementTree.parse(path.parent / f"{path.parent.name}.urdf").getroot()
        links = {
            link.get("name"): [
                trimesh.creation.box(numbers(part(c, "geometry/box"), "size"), origin_of(c))
                for c in link.findall("collision")
            ]
            for link in robot.findall("link")
        }
        found += [(r, links[r["parent_link"]]) for r in receptacles(load(path))]
    return found


def ray_length(start: np.ndarray, direction: np.ndarray, meshes: list[trimesh.Trimesh]) -> float:
    """Distance to the first triangle that the ray hits."""
    a, b, c = np.moveaxis(np.vstack([m.triangles for m in meshes]), 1, 0)
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        length = np.einsum("ij,ij->i", a - start, normal) / (normal @ direction)
        hit = start + length[:, None] * direction
        inside = np.min(
            [
                np.einsum("ij,ij->i", np.cross(q - p, hit - p), normal)
                for p, q in ((a, b), (b, c), (c, a))
            ],
            axis=0,
        )
        good = (inside >= -1e-15) & (length >= 0)
    return float(length[good].min()) if good.any() else np.inf


def test_receptacles_lie_on_a_surface_and_are_free():
    for receptacle, meshes in supports():
        center, half = np.array(receptacle["position"]), np.array(receptacle["scale"])
        up = np.array(receptacle.get("up", [0, 1, 0]), float)
        assert (half > 0).all()
        bottom = center - up * np.abs(half @ up)
        flat = [np.eye(3)[k] * half[k] * 0.9 for k in range(3) if not up[k]]
        for u in (-1, 0, 1):
            for v in (-1, 0, 1):
                start = bottom + 0.02 * up + u * flat[0] + v * flat[1]
                assert ray_length(start, -up, meshes) == pytest.approx(0.02, abs=0.005)
        free = solid_of(
            trimesh.creation.box(
                2 * half, transform=trimesh.transformations.translation_matrix(center)
            )
        )
        assert max(depth(free, solid_of(m)) for m in meshes) < 0.002


def test_links_never_touch_one_another():
    for name in ARTICULATIONS:
        model = jointed(name)
        for joint, (lower, upper) in model.limits().items():
            for value in np.linspace(lower, upper, 9):
                links = model.at({joint: float(value)})
                for (first, a), (second, b) in combinations(links.items(), 2):
                    worst = deepest(a, b, -0.001)
                    assert worst < 0, (
                        f"{first} touches {second} at {joint} = {value:.2f}: {worst:.4f} m"
                    )


def test_a_bar_is_at_every_handle_marker():
    drawers = ("1_top", "1_bottom", "2_top", "2_middle", "2_bottom", "3", "4")
    for name, link, marker in (
        ("fridge", "top_door", (0.10, -0.62, 0.2)),
        *(("kitchen_counter", f"drawer{n}", (0.30, 0.0, 0.0)) for n in drawers),
    ):
        solids = jointed(name).solids[link]
        bars = [s for s in solids if np.sort(np.ptp(s.corners, axis=0))[1] < 0.017]
        centers = [s.corners.mean(axis=0) for s in bars if np.ptp(s.corners, axis=0).max() > 0.15]
        assert min(np.linalg.norm(c - marker) for c in centers) < 0.02, link
