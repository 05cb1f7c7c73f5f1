"""Object templates of the embedded dataset: categories, collision parts, masses, resting poses."""

import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hab_tasks.scenes.habitat.load import load_template
from hab_tasks.scenes.spec import ObjectTemplate

sapien = pytest.importorskip("sapien")

ROOT = Path(__file__).parents[2] / "assets" / "apartment"
CONFIGS = sorted((ROOT / "configs/objects").glob("*.object_config.json"))
PICKABLES = {p for p in CONFIGS if p.name[:3].isdigit()}
TEMPLATES = [p for p in CONFIGS if p not in PICKABLES]
# What hangs on a wall: it does not rest on a floor by itself.
HANGING = {
    "frl_apartment_picture_01",
    "frl_apartment_picture_02",
    "frl_apartment_picture_03",
    "frl_apartment_tv_screen",
}
GROUPS = {
    "kitchen": "bowl cup plate pan kitchen_utensil knife_block chopping_board small_appliance "
    "refrigerator",
    "seats": "beanbag bed chair cushion sofa stool",
    "storage": "basket bin box cabinet rack table tv_stand wall_cabinet",
    "clothes": "cloth clothes_hanger handbag mat rug shoe towel umbrella",
    "electronics": "camera monitor remote_control tablet tv_screen",
    "decoration": "bike book clock indoor_plant lamp picture vase",
}
# Kilograms per cubic metre of collision volume: cushions and hollow things below, crockery above.
DENSITY = (10, 2200)
HALF = math.sqrt(0.5)
Z_UP = sapien.Pose(q=[HALF, HALF, 0, 0])  # y-up to z-up
STEP_S, SECONDS, DROP_M, SPACING_M = 1 / 120, 2, 0.005, 3.5


def name_of(config: Path) -> str:
    return config.name.removesuffix(".object_config.json")


def template_of(config: Path) -> ObjectTemplate:
    template = load_template(config)
    assert template is not None
    return template


def solids_of(template: ObjectTemplate) -> list[trimesh.Trimesh]:
    (source,) = template.collision
    assert source.kind == "convex_parts"
    assert source.file is not None
    return pieces(source.file)


def corners_of(meshes: list[trimesh.Trimesh]) -> np.ndarray:
    return np.vstack([m.vertices for m in meshes])


def pieces(path: Path) -> list[trimesh.Trimesh]:
    return list(trimesh.load_scene(path).geometry.values())


def convex_file(name: str) -> Path:
    return ROOT / "objects/convex" / f"{name}_cv_decomp.glb"


def bare_scene():
    """A scene with a floor and without a renderer."""
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(STEP_S)
    builder = scene.create_actor_builder()
    builder.add_box_collision(sapien.Pose([0, 0, -0.05]), [100, 100, 0.05])
    builder.initial_pose = sapien.Pose()
    builder.build_static()
    return scene


def add(scene, name, place, *, above_m=0.0):
    """Drops a template upright; returns its actor and where it should come to rest."""
    config = json.loads((ROOT / f"configs/objects/{name}.object_config.json").read_text())
    friction = config["friction_coefficient"]
    builder = scene.create_actor_builder()
    material = sapien.physx.PhysxMaterial(friction, friction, 0.0)
    builder.add_multiple_convex_collisions_from_file(str(convex_file(name)), material=material)
    bottom_m = float(corners_of(pieces(convex_file(name)))[:, 1].min())
    rest = sapien.Pose([*place, above_m - bottom_m]) * Z_UP
    builder.initial_pose = sapien.Pose([0, 0, DROP_M]) * rest
    actor = builder.build(name=name)
    actor.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent).mass = config["mass"]
    return actor, rest


def test_there_are_replica_cads_92_and_more_than_20_classes():
    named = [p for p in TEMPLATES if p.name.startswith("frl_apartment_")]
    assert len(named) == 92
    assert len({template_of(p).category for p in named}) >= 20


@pytest.mark.assets
def test_names_and_classes_are_replica_cads(replica_cad):
    theirs = {p.name: json.loads(p.read_text()) for p in replica_cad.glob("configs/objects/*.json")}
    ours = {p.name: json.loads(p.read_text()) for p in TEMPLATES}
    assert set(ours) - set(theirs) == {"apartment_bed.object_config.json"}
    assert not set(theirs) - set(ours)
    different = {n for n in theirs if ours[n]["semantic_id"] != theirs[n]["semantic_id"]}
    # There both are labelled as chopping boards.
    assert {name_of(Path(n)) for n in different} == {
        "frl_apartment_clothes_hanger_01",
        "frl_apartment_clothes_hanger_02",
    }


def test_kitchen_things_are_the_largest_group():
    group = {c: name for name, classes in GROUPS.items() for c in classes.split()}
    categories = [template_of(p).category for p in TEMPLATES]
    templates = Counter(group[c] for c in categories)
    classes = Counter(group[c] for c in set(categories))
    assert templates.most_common(1)[0][0] == "kitchen"
    assert classes.most_common(1)[0][0] == "kitchen"
    assert Counter(categories).most_common(1)[0][0] == "kitchen_utensil"


def test_lexicon_names_every_class():
    dataset = json.loads((ROOT / "apartment.scene_dataset_config.json").read_text())
    label = dataset["scene_instances"]["default_attributes"]["semantic_scene_instance"]
    file = ROOT / dataset["semantic_scene_descriptor_instances"][label]
    lexicon = {c["id"]: c["name"] for c in json.loads(file.read_text())["classes"]}
    used = {}
    for path in TEMPLATES:
        config = json.loads(path.read_text())
        used[config["semantic_id"]] = config["user_defined"]["category"]
    assert used == lexicon


def test_templates_are_complete():
    for config in CONFIGS:
        template = template_of(config)
        assert template.category
        assert 0.4 <= template.friction <= 1.0
        assert template.mass_kg is not None
        volume_m3 = sum(piece.volume for piece in solids_of(template))
        assert DENSITY[0] < template.mass_kg / volume_m3 < DENSITY[1]


def test_convex_parts_fill_the_bounds_of_what_is_seen():
    for config in CONFIGS:
        template = template_of(config)
        parts = solids_of(template)
        for part in parts:
            assert part.is_watertight
            assert part.volume == pytest.approx(part.convex_hull.volume, rel=1e-3)
        assert template.visual_file is not None
        seen, solid = corners_of(pieces(template.visual_file)), corners_of(parts)
        size = np.ptp(seen, axis=0)
        for end in (np.min, np.max):
            assert (
                np.abs(end(seen, axis=0) - end(solid, axis=0)) <= np.maximum(0.125 * size, 0.005)
            ).all()
        assert (np.abs(np.ptp(solid, axis=0) / size - 1) <= 0.25).all()


def test_receptacles_are_free_boxes_on_a_part():
    for config in CONFIGS:
        template = template_of(config)
        parts = solids_of(template)
        for receptacle in template.receptacles:
            center, half = np.array(receptacle.body_from_box[:3]), np.array(receptacle.half_size_m)
            grid = np.stack(np.meshgrid(*[np.linspace(-0.98, 0.98, 7)] * 3), axis=-1).reshape(-1, 3)
            inside = center + grid * half + [0.0, 0.002, 0.0]
            below = grid * half
            below[:, 1] = -half[1] - 0.004
            held = np.zeros(len(grid), bool)
            for part in parts:
                normal, foot = part.face_normals, part.triangles_center
                reach = np.sum(foot * normal, axis=1)
                assert ((inside @ normal.T - reach).max(axis=1) > -1e-4).all(), receptacle.name
                held |= ((center + below) @ normal.T - reach).max(axis=1) <= 1e-4
            assert held.mean() > 0.9, receptacle.name


def test_everything_stands_where_it_is_put():
    """After two seconds; all that stands or lies by itself."""
    scene, dropped = bare_scene(), {}
    names = [name_of(p) for p in CONFIGS if name_of(p) not in HANGING]
    for index, name in enumerate(names):
        row, column = divmod(index, 12)
        dropped[name] = add(scene, name, (SPACING_M * column, SPACING_M * row))
    for _ in range(round(SECONDS / STEP_S)):
        scene.step()
    for name, (actor, rest) in dropped.items():
        assert np.linalg.norm(actor.pose.p - rest.p) < 0.01, name
        turn_rad = 2 * math.acos(min(1.0, abs(float((rest.inv() * actor.pose).q[0]))))
        assert math.degrees(turn_rad) < 5, name


HOLDERS = {
    "frl_apartment_bowl_01": "013_apple",
    "frl_apartment_bowl_02": "013_apple",
    "frl_apartment_bowl_03": "013_apple",
    "frl_apartment_bowl_06": "017_orange",
    "frl_apartment_bowl_07": "017_orange",
    "frl_apartment_pan_01": "013_apple",
    "frl_apartment_plate_01": "009_gelatin_box",
    "frl_apartment_plate_02": "024_bowl",
    "frl_apartment_kitchen_utensil_05": "025_mug",
    "frl_apartment_basket": "002_master_chef_can",
    "frl_apartment_box": "005_tomato_soup_can",
    "frl_apartment_bin_03": "003_cracker_box",
}


def test_hollow_things_hold_what_is_put_in_them():
    scene, pairs = bare_scene(), []
    for index, (holder, held) in enumerate(HOLDERS.items()):
        place = (SPACING_M * index, 0.0)
        outer, rest = add(scene, holder, place)
        inner, _ = add(scene, held, place, above_m=0.03)
        pairs.append((holder, outer, inner, rest))
    for _ in range(round(SECONDS / STEP_S)):
        scene.step()
    for holder, outer, inner, rest in pairs:
        corners = corners_of(pieces(convex_file(holder)))
        x, y, z = (outer.pose.inv() * inner.pose).p
        low, high = corners.min(axis=0), corners.max(axis=0)
        assert low[0] < x < high[0], holder
        assert low[2] < z < high[2], holder
        assert low[1] < y, holder
        assert np.linalg.norm(outer.pose.p - rest.p) < 0.03, holder
