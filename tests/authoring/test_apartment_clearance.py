"""Templates of the embedded dataset: surfaces support objects, and joints move freely."""

from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import trimesh
from apartment_solids import (
    ROOT,
    collision_of,
    deepest,
    jointed,
    load,
    numbers,
    object_config,
    origin_of,
    part,
    receptacles,
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


def test_receptacles_are_free_boxes_on_a_surface():
    for receptacle, meshes in supports():
        center, half = np.array(receptacle["position"]), np.array(receptacle["scale"])
        up = np.array(receptacle.get("up", [0, 1, 0]), float)
        assert (half > 0).all()
        grid = half * np.stack(np.meshgrid(*[np.linspace(-0.98, 0.98, 7)] * 3), -1).reshape(-1, 3)
        inside = center + grid + 0.002 * up
        below = center + grid - np.outer(grid @ up + abs(half @ up) + 0.004, up)
        held = np.zeros(len(grid), bool)
        for mesh in meshes:
            normal = mesh.face_normals
            reach = np.sum(mesh.triangles_center * normal, axis=1)
            assert ((inside @ normal.T - reach).max(axis=1) > -1e-4).all(), receptacle["name"]
            held |= (below @ normal.T - reach).max(axis=1) <= 1e-4
        assert held.mean() > 0.9, receptacle["name"]


def test_links_never_touch_one_another():
    for name in ARTICULATIONS:
        model = jointed(name)
        for joint, (lower, upper) in model.limits().items():
            for value in np.linspace(lower, upper, 9):
                links = model.at({joint: float(value)})
                for (first, a), (second, b) in combinations(links.items(), 2):
                    assert deepest(a, b, -0.001) < 0, (first, second, joint, value)


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
