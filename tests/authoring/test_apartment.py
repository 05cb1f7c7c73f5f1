"""The embedded dataset's files: made by its script, complete, convex, with ReplicaCAD's joints."""

import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from apartment_solids import ROOT, collision_of, load, object_config, part, pieces

from hab_tasks.world.scenes.habitat.load import load_template

CONFIGS = sorted((ROOT / "configs/objects").glob("*.object_config.json"))
TEMPLATES = [p for p in CONFIGS if not p.name[:3].isdigit()]

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
LEVELS = ("top", "middle", "bottom")
# Joint limits in radians and metres, as in ReplicaCAD's models at the scale its scenes use.
LIMITS = {
    "fridge": {"top_door_hinge": (0, 2.3), "bottom_door_hinge": (0, 2.5)},
    "kitchen_counter": {
        f"{side}_slide_{level}": (0, 0.5)
        for side, levels in (("left", LEVELS[::2]), ("middle", LEVELS), ("right", LEVELS[::2]))
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
# Kilograms per cubic metre of collision volume: cushions and hollow things below, crockery above.
DENSITY = (10, 2200)


@pytest.mark.slow
def test_script_makes_the_same_bytes():
    command = [sys.executable, "-m", "hab_authoring.apartment", "--out", str(ROOT), "--check"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_collision_pieces_are_convex_and_closed():
    for path in ROOT.rglob("*_cv_decomp.glb"):
        for piece in pieces(path):
            assert piece.is_watertight
            assert piece.volume > 0
            assert len(piece.vertices) <= 60
            planes = piece.vertices @ piece.face_normals.T - np.sum(
                piece.triangles_center * piece.face_normals, axis=1
            )
            assert planes.max() < 2e-5, "a corner lies outside one of the faces"


def test_pickables_have_published_size_and_mass():
    for name, (size_mm, mass_kg) in YCB.items():
        path, config = object_config(name)
        seen = pieces((path.parent / config["render_asset"]).resolve())
        for meshes in (collision_of(path, config), seen):
            corners = np.vstack([m.vertices for m in meshes])
            np.testing.assert_allclose(np.ptp(corners, axis=0) * 1000, size_mm, atol=4)
        assert config["mass"] == pytest.approx(mass_kg)
        assert config["COM"] == [0, 0, 0]
        assert config["user_defined"] == {"category": name[4:]}


def test_joints_are_those_of_replica_cad():
    for name, limits in LIMITS.items():
        found = {}
        for joint in ElementTree.parse(ROOT / f"urdf/{name}/{name}.urdf").iter("joint"):
            if joint.get("type") != "fixed":
                limit = part(joint, "limit").attrib
                found[joint.get("name")] = (float(limit["lower"]), float(limit["upper"]))
                assert limit["effort"] == "44.4"
                # ReplicaCAD states 0.01 for both, a placeholder.
                friction = "4" if joint.get("type") == "prismatic" else "0.8"
                dynamics = part(joint, "dynamics").attrib
                assert dynamics == {"damping": "0.01", "friction": friction}
        assert found == limits


def test_inertia_is_physical():
    for path in ROOT.rglob("*.urdf"):
        for link in ElementTree.parse(path).getroot().iter("inertia"):
            xx, yy, zz, xy, xz, yz = (
                float(link.get(k)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            )
            moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            assert moments[0] > 0
            assert moments[2] <= moments[0] + moments[1] + 1e-6


def test_templates_are_complete_and_their_parts_fill_the_bounds_of_what_is_seen():
    for config in CONFIGS:
        template = load_template(config)
        assert template.category
        assert 0.4 <= template.friction <= 1.0
        parts = collision_of(config, load(config))
        assert DENSITY[0] < template.mass_kg / sum(p.volume for p in parts) < DENSITY[1]
        seen, solid = (
            np.vstack([m.vertices for m in meshes])
            for meshes in (pieces(template.visual_file), parts)
        )
        size = np.ptp(seen, axis=0)
        for end in (np.min, np.max):
            gap = np.abs(end(seen, axis=0) - end(solid, axis=0))
            assert (gap <= np.maximum(0.125 * size, 0.005)).all()
        assert (np.abs(np.ptp(solid, axis=0) / size - 1) <= 0.25).all()


@pytest.mark.assets
def test_names_and_classes_are_replica_cads(replica_cad):
    theirs = {p.name: load(p) for p in replica_cad.glob("configs/objects/*.json")}
    ours = {p.name: load(p) for p in TEMPLATES}
    assert ours.keys() - theirs.keys() == {"apartment_bed.object_config.json"}
    assert not theirs.keys() - ours.keys()
    different = {n for n in theirs if ours[n]["semantic_id"] != theirs[n]["semantic_id"]}
    # There both are labelled as chopping boards.
    hangers = (f"frl_apartment_clothes_hanger_0{n}.object_config.json" for n in (1, 2))
    assert different == set(hangers)
