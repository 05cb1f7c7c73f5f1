"""The embedded dataset's room to move: nothing overlaps, floats or jams, and the floor is free."""

import json
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from scipy import ndimage
from scipy.spatial import ConvexHull

ASSETS = Path(__file__).parents[2] / "assets"
ROOT = ASSETS / "apartment"
SCENE = ROOT / "configs/scenes/v3_sc0_staging_00.scene_instance.json"
OBJECTS = sorted(p.name.split(".")[0] for p in (ROOT / "configs/objects").glob("*.json"))
ARTICULATIONS = sorted(p.parent.name for p in ROOT.rglob("*.urdf"))
ROBOT_RADIUS_M, ROBOT_HEIGHT_M, CELL_M = 0.3, 1.5, 0.025


@dataclass(frozen=True)
class Solid:
    """A convex piece: corners, and the axes along which it could be separated from another."""

    corners: np.ndarray
    normals: np.ndarray
    edges: np.ndarray

    def at(self, pose: np.ndarray) -> "Solid":
        turn = pose[:3, :3].T
        return Solid(self.corners @ turn + pose[:3, 3], self.normals @ turn, self.edges @ turn)


def solid_of(mesh: trimesh.Trimesh) -> Solid:
    corner = mesh.vertices[mesh.faces]
    edges = np.diff(corner, axis=1).reshape(-1, 3)
    return Solid(np.asarray(mesh.vertices), directions(mesh.face_normals), directions(edges))


def directions(vectors: np.ndarray) -> np.ndarray:
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    first = np.argmax(np.abs(unit) > 1e-6, axis=1)
    unit = unit * np.sign(unit[np.arange(len(unit)), first])[:, None]
    return np.unique(np.round(unit, 4) + 0.0, axis=0)


def depth(a: Solid, b: Solid) -> float:
    """How deep two convex pieces reach into one another in metres; negative when apart."""
    low, high = (
        np.max([s.corners.min(0) for s in (a, b)], 0),
        np.min([s.corners.max(0) for s in (a, b)], 0),
    )
    if np.min(high - low) <= 0:
        return float(np.min(high - low))
    crossed = (
        np.cross(a.edges[:, None], b.edges[None]).reshape(-1, 3)
        if len(a.edges) * len(b.edges) < 900
        else np.zeros((0, 3))
    )
    length = np.linalg.norm(crossed, axis=1)
    axes = np.vstack([a.normals, b.normals, crossed[length > 0.1] / length[length > 0.1][:, None]])
    pa, pb = a.corners @ axes.T, b.corners @ axes.T
    return float(np.min(np.minimum(pa.max(0) - pb.min(0), pb.max(0) - pa.min(0))))


def deepest(first: list[Solid], second: list[Solid], above: float) -> float:
    """The deepest overlap of two groups, or `above` when their boxes are never closer than that."""
    if not first or not second:
        return above
    lows, highs = (np.array([f(s.corners, axis=0) for s in first]) for f in (np.min, np.max))
    low, high = (np.array([f(s.corners, axis=0) for s in second]) for f in (np.min, np.max))
    room = np.minimum(highs[:, None], high[None]) - np.maximum(lows[:, None], low[None])
    near = np.argwhere(room.min(axis=2) > above)
    return max((depth(first[i], second[j]) for i, j in near), default=above)


def load(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def receptacles(config: dict) -> list[dict]:
    return [v for k, v in config["user_defined"].items() if k.startswith("receptacle_aabb_")]


def pieces(path: Path) -> list[trimesh.Trimesh]:
    return list(trimesh.load(path, force="scene").geometry.values())


def pose_of(translation: list[float], rotation: list[float]) -> np.ndarray:
    pose = trimesh.transformations.quaternion_matrix(rotation)
    pose[:3, 3] = translation
    return pose


def numbers(element: ElementTree.Element, key: str) -> np.ndarray:
    return np.array(element.get(key, "0 0 0").split(), float)


def origin_of(element: ElementTree.Element) -> np.ndarray:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    pose = trimesh.transformations.euler_matrix(*numbers(origin, "rpy"))
    pose[:3, 3] = numbers(origin, "xyz")
    return pose


@dataclass(frozen=True)
class Jointed:
    """The collision side of a URDF."""

    joints: list[ElementTree.Element]
    solids: dict[str, list[Solid]]

    def place(self, positions: dict[str, float]) -> dict[str, np.ndarray]:
        """Link poses in the root's frame."""
        poses = {"root": np.eye(4)}
        for joint in self.joints:
            move, value = np.eye(4), positions.get(joint.get("name"), 0.0)
            if joint.get("type") == "prismatic":
                move[:3, 3] = value * numbers(joint.find("axis"), "xyz")
            elif joint.get("type") == "revolute":
                move = trimesh.transformations.rotation_matrix(
                    value, numbers(joint.find("axis"), "xyz")
                )
            parent = joint.find("parent").get("link")
            poses[joint.find("child").get("link")] = poses[parent] @ origin_of(joint) @ move
        return poses

    def limits(self) -> dict[str, tuple[float, float]]:
        found = ((j.get("name"), j.find("limit")) for j in self.joints)
        return {
            n: (float(x.get("lower")), float(x.get("upper"))) for n, x in found if x is not None
        }

    def at(self, positions: dict[str, float]) -> dict[str, list[Solid]]:
        poses = self.place(positions)
        return {link: [s.at(poses[link]) for s in items] for link, items in self.solids.items()}


def jointed(name: str) -> Jointed:
    robot = ElementTree.parse(ROOT / "urdf" / name / f"{name}.urdf").getroot()
    solids = {}
    for link in robot.findall("link"):
        solids[link.get("name")] = [
            solid_of(trimesh.creation.box(numbers(c.find("geometry/box"), "size"))).at(origin_of(c))
            for c in link.findall("collision")
        ]
    return Jointed(robot.findall("joint"), solids)


def object_config(name: str) -> tuple[Path, dict]:
    path = ROOT / "configs/objects" / f"{name}.object_config.json"
    return path, load(path)


def collision_of(path: Path, config: dict) -> list[trimesh.Trimesh]:
    return pieces((path.parent / config["collision_asset"]).resolve())


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
                trimesh.creation.box(numbers(c.find("geometry/box"), "size"), origin_of(c))
                for c in link.findall("collision")
            ]
            for link in robot.findall("link")
        }
        found += [(r, links[r["parent_link"]]) for r in receptacles(load(path))]
    return [pytest.param(r, meshes, id=r["name"]) for r, meshes in found]


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


@pytest.mark.parametrize(("receptacle", "meshes"), supports())
def test_receptacle_lies_on_a_surface_and_is_free(receptacle, meshes):
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
        trimesh.creation.box(2 * half, transform=trimesh.transformations.translation_matrix(center))
    )
    assert max(depth(free, solid_of(m)) for m in meshes) < 0.002


@pytest.fixture(scope="module")
def scene_solids() -> list[tuple[str, list[Solid]]]:
    """All fixed things of the scene, joints closed, in the scene's frame."""
    scene, out = load(SCENE), []
    stage = next((ROOT / "stages/convex").glob("*.glb"))
    out.append(("stage", [solid_of(m) for m in pieces(stage)]))
    for index, item in enumerate(scene["object_instances"]):
        pose = pose_of(item["translation"], item["rotation"])
        meshes = collision_of(*object_config(item["template_name"]))
        out.append((f"{item['template_name']}:{index}", [solid_of(m).at(pose) for m in meshes]))
    for item in scene["articulated_object_instances"]:
        pose = pose_of(item["translation"], item["rotation"])
        links = jointed(item["template_name"]).at({})
        out.append((item["template_name"], [s.at(pose) for group in links.values() for s in group]))
    return out


def test_nothing_reaches_into_anything_else(scene_solids):
    clashes = {}
    for (name, first), (other, second) in combinations(scene_solids, 2):
        worst = deepest(first, second, 0.01)
        if worst > 0.01:
            clashes[f"{name} and {other}"] = round(worst, 4)
    assert not clashes


def test_everything_stands_on_something(scene_solids):
    hung = ("picture", "tv_screen", "clock", "kitchenCupboard", "door2", "stage")
    lower = trimesh.transformations.translation_matrix([0, -0.02, 0])
    for index, (name, group) in enumerate(scene_solids):
        if not any(word in name for word in hung):
            below = [s for k, (_, others) in enumerate(scene_solids) if k != index for s in others]
            assert deepest([s.at(lower) for s in group], below, 0.0) > 0, f"{name} floats"


@pytest.mark.parametrize("name", ARTICULATIONS)
def test_links_never_touch_one_another(name):
    model = jointed(name)
    for joint, (lower, upper) in model.limits().items():
        for value in np.linspace(lower, upper, 9):
            links = model.at({joint: float(value)})
            for (first, a), (second, b) in combinations(links.items(), 2):
                worst = deepest(a, b, -0.001)
                assert worst < 0, (
                    f"{first} touches {second} at {joint} = {value:.2f}: {worst:.4f} m"
                )


@pytest.mark.parametrize(
    ("name", "link", "marker"),
    [("fridge", "top_door", (0.10, -0.62, 0.2))]
    + [
        ("kitchen_counter", f"drawer{n}", (0.30, 0.0, 0.0))
        for n in ("1_top", "1_bottom", "2_top", "2_middle", "2_bottom", "3", "4")
    ],
)
def test_a_bar_is_at_the_handle_marker(name, link, marker):
    bars = [s for s in jointed(name).solids[link] if np.sort(np.ptp(s.corners, axis=0))[1] < 0.017]
    centers = [s.corners.mean(axis=0) for s in bars if np.ptp(s.corners, axis=0).max() > 0.15]
    assert min(np.linalg.norm(c - marker) for c in centers) < 0.02


@pytest.fixture(scope="module")
def free_floor(scene_solids) -> np.ndarray:
    """Cells of the floor where the robot's centre may be; x by z, from the walls' outer corner."""
    size = tuple(round((high - low) / CELL_M) for low, high in ((-2.66, 4.60), (-4.76, 8.17)))
    floor, blocked = np.zeros(size, bool), np.zeros(size, bool)
    for s in (s for _, group in scene_solids for s in group):
        low, high = s.corners[:, 1].min(), s.corners[:, 1].max()
        if low < -0.05:
            cover(floor, s)
        elif high > 0.03 and low < ROBOT_HEIGHT_M:
            cover(blocked, s)
    room = np.pad(floor & ~blocked, 1)
    return ndimage.distance_transform_edt(room)[1:-1, 1:-1] * CELL_M > ROBOT_RADIUS_M


def cover(grid: np.ndarray, solid: Solid) -> None:
    """Mark the cells whose centre lies under a convex piece, by its outline's edges."""
    flat = (solid.corners[:, [0, 2]] - (-2.66, -4.76)) / CELL_M - 0.5
    hull = flat[ConvexHull(flat).vertices]
    low = np.maximum(np.floor(flat.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(flat.max(axis=0)).astype(int) + 1, grid.shape)
    cells = np.stack(np.mgrid[low[0] : high[0], low[1] : high[1]], axis=-1)[..., None, :] - hull
    step = np.roll(hull, -1, axis=0) - hull
    inside = np.all(step[:, 0] * cells[..., 1] - step[:, 1] * cells[..., 0] >= 0, axis=-1)
    grid[low[0] : high[0], low[1] : high[1]] |= inside


def test_free_floor_is_one_piece(free_floor):
    _, count = ndimage.label(free_floor)
    assert count == 1
    assert free_floor.sum() * CELL_M**2 > 25.8, "less than the smallest ReplicaCAD staging scene"


FRONTS = {
    # A point that the robot must reach, at most 0.9 m from the edge of what it picks from.
    "sofa": (-1.07, 1.25),
    "fridge": (1.50, 4.40),
    "counter left": (1.45, 7.45),
    "sink": (1.45, 6.70),
    "counter right": (1.45, 5.60),
    "table_01 south": (2.75, 2.15),
    "table_01 west": (1.55, 3.05),
    "table_02": (3.05, 6.12),
    "tvstand": (3.40, 1.25),
    "coffee table": (0.70, 1.25),
}


@pytest.mark.parametrize("place", sorted(FRONTS))
def test_robot_fits_in_front_of_what_it_picks_from(free_floor, place):
    x, z = FRONTS[place]
    i, j = round((x + 2.66) / CELL_M), round((z + 4.76) / CELL_M)
    reach = round((0.45 - ROBOT_RADIUS_M) / CELL_M)
    # 0.9 m of floor: the robot's centre may be up to 0.15 m to either side.
    assert free_floor[i - reach : i + reach + 1, j - reach : j + reach + 1].all()


@pytest.mark.parametrize(
    ("name", "joint", "reach"),
    [
        ("fridge", "top_door_hinge", 2.3),
        ("fridge", "bottom_door_hinge", 2.5),
        ("door2", "root_rotation", -2.0),
        ("cabinet", "right_slide", -0.76),
        ("chestOfDrawers_01", "drawer_botR", 0.2),
    ]
    + [("kitchen_counter", joint, 0.5) for joint in jointed("kitchen_counter").limits()]
    + [
        ("kitchenCupboard_01", joint, 1.6 * np.sign(lower + upper))
        for joint, (lower, upper) in jointed("kitchenCupboard_01").limits().items()
    ],
)
def test_room_lets_it_open(scene_solids, name, joint, reach):
    entries = load(SCENE)["articulated_object_instances"]
    item = next(e for e in entries if e["template_name"] == name)
    pose, model = pose_of(item["translation"], item["rotation"]), jointed(name)
    moving = next(j for j in model.joints if j.get("name") == joint).find("child").get("link")
    for value in np.linspace(0, reach, 16):
        link = [s.at(pose) for s in model.at({joint: float(value)})[moving]]
        for other, group in scene_solids:
            assert other == name or deepest(link, group, 0.001) <= 0.001, f"{other} at {value:.2f}"
