"""The embedded dataset: reproducible by its script, complete, convex, at rest, without overlaps."""

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

ASSETS = Path(__file__).parents[2] / "assets"
ROOT = ASSETS / "apartment"
SCENE = ROOT / "configs/scenes/v3_sc0_staging_00.scene_instance.json"
MAX_BYTES = 9_000_000

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


def load(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def pieces(path: Path) -> list[trimesh.Trimesh]:
    return list(trimesh.load(path, force="scene").geometry.values())


def numbers(element: ElementTree.Element, key: str) -> np.ndarray:
    return np.array(element.get(key, "0 0 0").split(), float)


def object_config(name: str) -> tuple[Path, dict]:
    path = ROOT / "configs/objects" / f"{name}.object_config.json"
    return path, load(path)


def collision_of(path: Path, config: dict) -> list[trimesh.Trimesh]:
    return pieces((path.parent / config["collision_asset"]).resolve())


OBJECTS = sorted(p.name.split(".")[0] for p in (ROOT / "configs/objects").glob("*.json"))
GLBS = sorted(ROOT.rglob("*_cv_decomp.glb"))


@pytest.mark.slow
def test_script_makes_the_same_bytes():
    command = [sys.executable, str(ASSETS / "tools/apartment"), "--out", str(ROOT), "--check"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


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


def test_collision_pieces_are_convex_and_closed():
    for path in GLBS:
        for piece in pieces(path):
            assert piece.is_watertight
            assert piece.volume > 0
            assert len(piece.vertices) <= 60
            planes = piece.vertices @ piece.face_normals.T - np.sum(
                piece.triangles_center * piece.face_normals, axis=1
            )
            assert planes.max() < 2e-5, "a corner lies outside one of the faces"


def test_pickables_have_published_size_and_mass():
    for name in YCB:
        path, config = object_config(name)
        size_mm, mass_kg = YCB[name]
        both = [
            collision_of(path, config),
            pieces((path.parent / config["render_asset"]).resolve()),
        ]
        for meshes in both:
            corners = np.vstack([m.vertices for m in meshes])
            np.testing.assert_allclose(np.ptp(corners, axis=0) * 1000, size_mm, atol=4)
        assert config["mass"] == pytest.approx(mass_kg)
        assert config["COM"] == [0, 0, 0]
        assert config["user_defined"] == {"category": name[4:]}


def test_joints_are_those_of_replica_cad():
    for name in LIMITS:
        found = {}
        for joint in ElementTree.parse(ROOT / f"urdf/{name}/{name}.urdf").iter("joint"):
            if joint.get("type") != "fixed":
                limit = joint.find("limit")
                found[joint.get("name")] = (float(limit.get("lower")), float(limit.get("upper")))
                assert limit.get("effort") == "44.4"
                # ReplicaCAD states 0.01 for both, a placeholder.
                friction = "4" if joint.get("type") == "prismatic" else "0.8"
                assert joint.find("dynamics").attrib == {"damping": "0.01", "friction": friction}
        assert found == LIMITS[name]


def test_inertia_is_physical():
    for path in ROOT.rglob("*.urdf"):
        for link in ElementTree.parse(path).getroot().iter("inertia"):
            xx, yy, zz, xy, xz, yz = (
                float(link.get(k)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            )
            moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            assert moments[0] > 0
            assert moments[2] <= moments[0] + moments[1] + 1e-6
