"""The embedded dataset: made by its script, complete, convex, at rest, and free of clashes."""

import json
import subprocess
import sys
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

ASSETS = Path(__file__).parents[2] / "assets"
ROOT = ASSETS / "apartment"
SCENE = ROOT / "configs/scenes/v3_sc0_staging_00.scene_instance.json"
MAX_BYTES = 5_000_000

# Width along x, height along y, depth along z in millimetres, and mass in kilograms, as published
# for the YCB object set. The mug's width holds its handle.
YCB = {
    "002_master_chef_can": ((102, 139, 102), 0.414),
    "003_cracker_box": ((158, 210, 60), 0.411),
    "004_sugar_box": ((89, 175, 38), 0.514),
    "005_tomato_soup_can": ((66, 101, 66), 0.349),
    "007_tuna_fish_can": ((85, 33, 85), 0.171),
    "008_pudding_box": ((110, 89, 35), 0.187),
    "009_gelatin_box": ((85, 73, 28), 0.097),
    "010_potted_meat_can": ((97, 82, 50), 0.370),
    "013_apple": ((75, 71, 75), 0.068),
    "017_orange": ((73, 71, 73), 0.047),
    "024_bowl": ((159, 53, 159), 0.147),
    "025_mug": ((110, 82, 80), 0.118),
    "026_sponge": ((114, 14, 72), 0.0062),
}
# Joint limits in radians and metres, as in ReplicaCAD's models at the scale its scenes use.
LIMITS = {
    "fridge": {"top_door_hinge": (0, 2.3), "bottom_door_hinge": (0, 2.5)},
    "kitchen_counter": {
        f"{side}_slide_{level}": (0, 0.5)
        for side, levels in (
            ("left", ("top", "bottom")),
            ("middle", ("top", "middle", "bottom")),
            ("right", ("top", "bottom")),
        )
        for level in levels
    },
    "kitchenCupboard_01": {
        f"door{kind}_{number}{side}_hinge": limits
        for kind in ("Whole", "Window")
        for number in (1, 2)
        for side, limits in (("L", (-2.3, 0)), ("R", (0, 2.3)))
    },
    "door2": {"root_rotation": (-2, 0)},
    "cabinet": {"left_slide": (0, 0.8), "right_slide": (-0.76, 0)},
    "chestOfDrawers_01": {
        f"drawer_{row}{side}": (0, 0.2) for row in ("top", "mid", "bot") for side in "LR"
    },
}


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


def load(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


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


OBJECTS = sorted(p.name.split(".")[0] for p in (ROOT / "configs/objects").glob("*.json"))
GLBS = sorted(ROOT.rglob("*_cv_decomp.glb"))


def test_script_makes_the_same_bytes():
    command = [sys.executable, str(ASSETS / "tools/apartment"), "--out", str(ROOT), "--check"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_check_names_a_changed_file(tmp_path):
    (tmp_path / "apartment").mkdir()
    command = [
        sys.executable,
        str(ASSETS / "tools/apartment"),
        "--out",
        str(tmp_path / "apartment"),
    ]
    result = subprocess.run([*command, "--check"], capture_output=True, text=True)
    assert result.returncode == 1
    assert "apartment.scene_dataset_config.json" in result.stderr


def test_dataset_is_small():
    assert sum(p.stat().st_size for p in ROOT.rglob("*") if p.is_file()) < MAX_BYTES


def test_configs_parse_and_files_exist():
    for path in ROOT.rglob("*.json"):
        config = load(path)
        for key in ("render_asset", "collision_asset"):
            if key in config:
                assert (path.parent / config[key]).is_file(), f"{path.name}: {config[key]}"
    for path in ROOT.rglob("*.urdf"):
        for mesh in ElementTree.parse(path).getroot().iter("mesh"):
            assert (path.parent / mesh.get("filename")).is_file()
            assert "," not in mesh.get("scale")


def test_scene_names_known_templates():
    scene = load(SCENE)
    assert {o["template_name"] for o in scene["object_instances"]} <= set(OBJECTS)
    for item in scene["articulated_object_instances"]:
        name = item["template_name"]
        assert (ROOT / "urdf" / name / f"{name}.urdf").is_file()
    stage = scene["stage_instance"]["template_name"]
    assert (ROOT / "configs/stages" / f"{stage}.stage_config.json").is_file()
    assert (ROOT / "configs" / f"{scene['default_lighting']}.lighting_config.json").is_file()


@pytest.mark.parametrize("path", GLBS, ids=lambda p: p.stem)
def test_collision_pieces_are_convex_and_closed(path):
    for piece in pieces(path):
        assert piece.is_watertight
        assert piece.volume > 0
        assert len(piece.vertices) <= 60
        planes = piece.vertices @ piece.face_normals.T - np.sum(
            piece.triangles_center * piece.face_normals, axis=1
        )
        assert planes.max() < 2e-5, "a corner lies outside one of the faces"


@pytest.mark.parametrize("name", sorted(YCB))
def test_pickables_have_published_size_and_mass(name):
    path, config = object_config(name)
    size_mm, mass_kg = YCB[name]
    both = [collision_of(path, config), pieces((path.parent / config["render_asset"]).resolve())]
    for meshes in both:
        corners = np.vstack([m.vertices for m in meshes])
        np.testing.assert_allclose(np.ptp(corners, axis=0) * 1000, size_mm, atol=4)
    assert config["mass"] == pytest.approx(mass_kg)
    assert config["COM"] == [0, 0, 0]


def supports() -> list:
    """Every receptacle with the solids of the object or link it belongs to."""
    found = []
    for name in OBJECTS:
        path, config = object_config(name)
        meshes = collision_of(path, config)
        found += [(r, meshes) for r in config.get("user_defined", {}).values()]
    for path in sorted(ROOT.rglob("*.ao_config.json")):
        robot = ElementTree.parse(path.parent / f"{path.parent.name}.urdf").getroot()
        links = {
            link.get("name"): [
                trimesh.creation.box(numbers(c.find("geometry/box"), "size"), origin_of(c))
                for c in link.findall("collision")
            ]
            for link in robot.findall("link")
        }
        found += [(r, links[r["parent_link"]]) for r in load(path)["user_defined"].values()]
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
        worst = max(depth(a, b) for a in first for b in second)
        if worst > 0.01:
            clashes[f"{name} and {other}"] = round(worst, 4)
    assert not clashes


def test_everything_stands_on_something(scene_solids):
    hung = ("picture", "tv_screen", "clock", "kitchenCupboard", "door2", "stage")
    for index, (name, group) in enumerate(scene_solids):
        if any(word in name for word in hung):
            continue
        below = [s for k, (_, others) in enumerate(scene_solids) if k != index for s in others]
        nearest = max(
            depth(a.at(trimesh.transformations.translation_matrix([0, -0.02, 0])), b)
            for a in group
            for b in below
        )
        assert nearest > 0, f"{name} floats"


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_joints_are_those_of_replica_cad(name):
    found = {}
    for joint in jointed(name).joints:
        if joint.get("type") != "fixed":
            limit = joint.find("limit")
            found[joint.get("name")] = (float(limit.get("lower")), float(limit.get("upper")))
            assert limit.get("effort") == "44.4"
            assert joint.find("dynamics").attrib == {"damping": "0.01", "friction": "0.01"}
    assert found == LIMITS[name]


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_links_never_touch_one_another(name):
    model = jointed(name)
    for joint, (lower, upper) in LIMITS[name].items():
        for value in np.linspace(lower, upper, 9):
            links = model.at({joint: float(value)})
            for (first, a), (second, b) in combinations(links.items(), 2):
                worst = max((depth(s, t) for s in a for t in b), default=-1.0)
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


def test_inertia_is_physical():
    for path in ROOT.rglob("*.urdf"):
        for link in ElementTree.parse(path).getroot().iter("inertia"):
            xx, yy, zz, xy, xz, yz = (
                float(link.get(k)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            )
            moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            assert moments[0] > 0
            assert moments[2] <= moments[0] + moments[1] + 1e-6
