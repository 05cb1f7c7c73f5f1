"""The collision shapes of the embedded dataset as convex solids, read from its files."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh

ROOT = Path(__file__).parents[1] / "assets" / "apartment"
SCENES = ROOT / "configs/scenes"


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


def box(low: np.ndarray, high: np.ndarray) -> Solid:
    """A box between two corners."""
    low, high = np.minimum(low, high), np.maximum(low, high)
    middle = trimesh.transformations.translation_matrix((low + high) / 2)
    return solid_of(trimesh.creation.box(high - low, transform=middle))


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


def scene_config(name: str) -> dict:
    return load(SCENES / f"{name}.scene_instance.json")


def receptacles(config: dict) -> list[dict]:
    return [v for k, v in config["user_defined"].items() if k.startswith("receptacle_aabb_")]


def pieces(path: Path) -> list[trimesh.Trimesh]:
    return list(trimesh.load_scene(path).geometry.values())


def pose_of(item: dict) -> np.ndarray:
    pose = trimesh.transformations.quaternion_matrix(item["rotation"])
    pose[:3, 3] = item["translation"]
    return pose


def object_config(name: str) -> tuple[Path, dict]:
    path = ROOT / "configs/objects" / f"{name}.object_config.json"
    return path, load(path)


def collision_of(path: Path, config: dict) -> list[trimesh.Trimesh]:
    return pieces((path.parent / config["collision_asset"]).resolve())


def part(element: ElementTree.Element, path: str) -> ElementTree.Element:
    """The element at a path, which must be there."""
    found = element.find(path)
    assert found is not None, f"no {path}"
    return found


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
            move, value = np.eye(4), positions.get(joint.attrib["name"], 0.0)
            if joint.get("type") == "prismatic":
                move[:3, 3] = value * numbers(part(joint, "axis"), "xyz")
            elif joint.get("type") == "revolute":
                move = trimesh.transformations.rotation_matrix(
                    value, numbers(part(joint, "axis"), "xyz")
                )
            parent = poses[part(joint, "parent").attrib["link"]]
            poses[part(joint, "child").attrib["link"]] = parent @ origin_of(joint) @ move
        return poses

    def limits(self) -> dict[str, tuple[float, float]]:
        found = ((j.attrib["name"], j.find("limit")) for j in self.joints)
        return {
            n: (float(x.attrib["lower"]), float(x.attrib["upper"]))
            for n, x in found
            if x is not None
        }

    def at(self, positions: dict[str, float]) -> dict[str, list[Solid]]:
        poses = self.place(positions)
        return {link: [s.at(poses[link]) for s in items] for link, items in self.solids.items()}

    def moved_by(self, joint: str) -> str:
        """The link that a joint moves."""
        found = next(j for j in self.joints if j.get("name") == joint)
        return part(found, "child").attrib["link"]


@lru_cache
def jointed(name: str) -> Jointed:
    robot = ElementTree.parse(ROOT / "urdf" / name / f"{name}.urdf").getroot()
    solids = {}
    for link in robot.findall("link"):
        solids[link.attrib["name"]] = [
            solid_of(trimesh.creation.box(numbers(part(c, "geometry/box"), "size"))).at(
                origin_of(c)
            )
            for c in link.findall("collision")
        ]
    return Jointed(robot.findall("joint"), solids)


@lru_cache
def template_solids(name: str) -> list[Solid]:
    return [solid_of(m) for m in collision_of(*object_config(name))]


@dataclass(frozen=True)
class Layout:
    """One scene, joints closed, in the scene's y-up frame."""

    config: dict
    solids: list[tuple[str, list[Solid]]]

    @cached_property
    def boxes(self) -> np.ndarray:
        """The box (N, 2, 3) around each entry of `solids`."""
        corners = [np.concatenate([s.corners for s in group]) for _, group in self.solids]
        return np.array([[c.min(axis=0), c.max(axis=0)] for c in corners])

    def near(self, solids: list[Solid], but: str = "") -> list[tuple[str, list[Solid]]]:
        """The entries of `solids` whose boxes meet the box around some solids."""
        corners = np.concatenate([s.corners for s in solids])
        low, high = corners.min(axis=0), corners.max(axis=0)
        met = ((self.boxes[:, 0] < high) & (self.boxes[:, 1] > low)).all(axis=1)
        return [
            entry for entry, hit in zip(self.solids, met, strict=True) if hit and entry[0] != but
        ]

    def articulation(self, name: str) -> np.ndarray:
        """The pose of the articulation with that template."""
        entries = self.config["articulated_object_instances"]
        return pose_of(next(e for e in entries if e["template_name"] == name))

    def receptacles(self) -> Iterator[tuple[dict, str, np.ndarray]]:
        """Each receptacle with its owner's key in `solids` and its frame's pose."""
        for index, item in enumerate(self.config["object_instances"]):
            for found in receptacles(object_config(item["template_name"])[1]):
                yield found, f"{item['template_name']}:{index}", pose_of(item)
        for item in self.config["articulated_object_instances"]:
            name = item["template_name"]
            links = jointed(name).place({})
            for found in receptacles(load(ROOT / "urdf" / name / f"{name}.ao_config.json")):
                yield found, name, pose_of(item) @ links[found["parent_link"]]


@lru_cache
def layout(name: str) -> Layout:
    config, out = scene_config(name), []
    stage = ROOT / f"stages/convex/{config['stage_instance']['template_name']}_cv_decomp.glb"
    out.append(("stage", [solid_of(m) for m in pieces(stage)]))
    for index, item in enumerate(config["object_instances"]):
        pose = pose_of(item)
        solids = [s.at(pose) for s in template_solids(item["template_name"])]
        out.append((f"{item['template_name']}:{index}", solids))
    for item in config["articulated_object_instances"]:
        links = jointed(item["template_name"]).at({})
        pose = pose_of(item)
        out.append((item["template_name"], [s.at(pose) for group in links.values() for s in group]))
    return Layout(config, out)
