"""Reading Habitat's scene dataset format: content, known defects and invalid input."""

import json
import logging
import math
import struct

import numpy as np
import pytest
import trimesh
from builders import (
    DRAWER_URDF,
    cpu_scene,
    table_config,
    tiny_dataset,
    tiny_scene,
    write_json,
    write_scene,
)

from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.scenes.habitat import load
from hab_tasks.scenes.habitat.dataset import SPLIT_MACROS, SceneDataset, resolve_dataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.objects import load_objects
from hab_tasks.scenes.pool import BodyPool

SCENE = "v3_sc0_staging_00"
TABLE = "configs/objects/table.object_config.json"


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A tiny dataset, a cache of its own, and nothing said yet."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(load, "_said", set())
    return tiny_dataset(tmp_path / "tiny")


def read(root, scene_id=SCENE):
    return load_scene(SceneDataset(root), scene_id)


def navmesh(low, high) -> bytes:
    """The head of a Detour tile behind a few other bytes: magic, 14 integers, 3 floats, bounds."""
    return (
        b"TESM0000"
        + struct.pack("<4s14i3f6f", b"VAND", *range(14), 0, 0, 0, *low, *high)
        + b"0" * 64
    )


def test_the_scene_is_read_z_up(root):
    spec = read(root)
    assert (spec.scene_id, spec.dataset, spec.missing) == (SCENE, "tiny", ())
    table, cube = spec.objects
    assert (table.name, cube.name) == ("table_:0000", "cube_:0000")
    assert (table.dynamic, cube.dynamic) == (False, True)
    # y-up (1, 0.4, 2) is z-up (1, -2, 0.4).
    assert np.allclose(table.world_from_object[:3], (1, -2, 0.4))
    # 90 degrees about Habitat's up, then about x: q = (h,h,0,0)(h,0,h,0) = (.5, .5, .5, .5).
    assert np.allclose(cube.world_from_object, (1, -2, 0.9, 0.5, 0.5, 0.5, 0.5))
    chest = spec.articulations[0]
    assert (chest.name, chest.scale) == ("chest_:0000", 2.0)
    assert np.allclose(chest.world_from_root[:3], (-1, 0, 0.2))


def test_both_folder_layouts_find_the_urdf_and_a_folder_of_its_own_name_comes_first(tmp_path):
    spec = read(tiny_dataset(tmp_path, urdf_file="chests/chest.urdf"))
    assert spec.articulations[0].urdf_file == (tmp_path / "urdf/chests/chest.urdf").resolve()
    other = tmp_path / "urdf/chest/chest.urdf"
    other.parent.mkdir()
    other.write_text(DRAWER_URDF.replace('filename="body.glb"', 'filename="../chests/body.glb"'))
    assert read(tmp_path).articulations[0].urdf_file == other.resolve()


def test_bodies_are_built_where_the_scene_says_with_commas_in_urdf_attributes(root):
    scene = cpu_scene()
    handles = BodyPool(scene, {}).show(read(root), ())
    scene._setup(enable_gpu=False)
    chest = handles.articulations["chest_:0000"]
    body = chest.links_map["body"]._objs[0].collision_shapes[0]
    # size="0.4 0.3, 0.2" at uniform scale 2: half sizes are the numbers themselves.
    assert np.allclose(body.half_size, (0.4, 0.3, 0.2))
    # The slide's limit of 0.25 m is scaled as well.
    assert np.allclose(chest.get_qlimits()[0], [(0.0, 0.5)])
    assert "1, 1, 1" in (root / "urdf/chests/chest.urdf").read_text(), "the user's file was changed"
    assert np.allclose(handles.static["table_:0000"].pose.p[0], (1, -2, 0.4), atol=1e-6)
    assert np.allclose(handles.loose["cube_:0000"].pose.p[0], (1, -2, 0.9), atol=1e-6)
    # No mass in the config: 500 kg/m3 of 0.1 x 0.2 x 0.3 m is 3 kg.
    assert handles.loose["cube_:0000"]._bodies[0].mass == pytest.approx(3.0, rel=1e-5)


def test_an_absent_stage_mesh_gives_a_shell_from_the_navmesh_and_is_said_once(root, caplog):
    (root / "navmeshes").mkdir()
    (root / f"navmeshes/{SCENE}.navmesh").write_bytes(navmesh((-3, -0.1, -4), (1, 2, 6)))
    write_scene(root, tiny_scene(), "v3_sc0_staging_01")
    with caplog.at_level(logging.WARNING):
        stage = read(root).stage
        read(root)
        read(root, "v3_sc0_staging_01")
    assert [r.message.count("stage meshes absent") for r in caplog.records] == [1]
    assert stage.visual_file is None
    floor, *walls = stage.collision
    assert len(walls) == 4
    # y-up: the floor's surface is at y = 0 and covers x -3..1, z -4..6 (plus the walls' 0.1 m).
    assert np.allclose(floor.center_m, (-1, -0.05, 1))
    assert np.allclose(floor.half_size_m, (2.1, 0.05, 5.1))


def test_a_stage_mesh_without_collision_parts_is_drawn_in_a_shell_of_its_size(root):
    room = root / "stages/room.glb"
    room.parent.mkdir()
    trimesh.Scene(trimesh.creation.box((4, 0.1, 4))).export(room)
    stage = read(root).stage
    assert stage.visual_file == room
    floor, *walls = stage.collision
    assert len(walls) == 4
    # The mesh spans x and z -2..2; the floor reaches under the walls' 0.1 m.
    assert np.allclose(floor.half_size_m, (2.1, 0.05, 2.1))
    assert np.allclose(sorted(w.center_m[0] for w in walls), (-2.05, 0, 0, 2.05))


def test_objects_without_a_mesh_are_skipped_with_one_warning(root, caplog):
    for name in ("bike", "hook"):
        config = {"render_asset": f"../../objects/{name}.glb"}
        write_json(root / f"configs/objects/{name}.object_config.json", config)
    scene = tiny_scene()
    scene["object_instances"] += [{"template_name": "bike"}, {"template_name": "bike"}]
    write_scene(root, scene)
    scene["object_instances"] += [{"template_name": "hook"}]
    write_scene(root, scene, "v3_sc0_staging_01")
    with caplog.at_level(logging.WARNING):
        spec, other = read(root), read(root, "v3_sc0_staging_01")
    assert (spec.missing, other.missing) == (("bike",), ("bike", "hook"))
    assert len(spec.objects) == len(other.objects) == 2
    warnings = [r.message for r in caplog.records if "skipped" in r.message]
    assert len(warnings) == 1
    assert "bike, hook" in warnings[0]


def test_an_absent_collision_mesh_becomes_the_bounding_box(root):
    # The cube's config asks for its bounding box, the table's for a mesh that is absent.
    config = table_config() | {"collision_asset": "../../objects/convex/none.glb"}
    write_json(root / TABLE, config)
    halves_m = ((0.5, 0.4, 0.3), (0.05, 0.1, 0.15))
    for item, half_size_m in zip(read(root).objects, halves_m, strict=True):
        (source,) = item.template.collision
        assert source.kind == "box"
        assert np.allclose(source.half_size_m, half_size_m)


def test_receptacle_scale_is_half_extents_and_may_be_negative(root):
    for scale in ((0.5, 0.1, 0.3), (-0.5, 0.1, -0.3)):
        write_json(root / TABLE, table_config(scale))
        (receptacle,) = read(root).receptacles
        assert receptacle.half_size_m == (0.5, 0.1, 0.3)
        assert receptacle.body == "table_:0000"
        assert receptacle.body_from_box == (0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0)
        assert receptacle.up == (0.0, 1.0, 0.0)


def test_receptacles_of_furniture_are_scaled_with_it(root):
    entry = {"name": "receptacle_aabb_in", "parent_link": "drawer", "position": [0.1, 0, 0.2]}
    entry["scale"] = [0.1, -0.05, 0.2]
    config = {"user_defined": {"receptacle_aabb_in": entry}}
    write_json(root / "urdf/chests/chest.ao_config.json", config)
    inside = next(r for r in read(root).receptacles if r.name == "receptacle_aabb_in")
    assert inside.body == "chest_:0000/drawer"
    # uniform_scale is 2
    assert np.allclose(inside.body_from_box[:3], (0.2, 0, 0.4))
    assert np.allclose(inside.half_size_m, (0.2, 0.1, 0.4))


def test_negative_and_directional_lamps_are_left_out(root):
    lamps = {
        "a": {"position": [1, 2, 3], "intensity": 2.0, "color": [1, 0.5, 0]},
        "b": {"position": [1, 2, 3], "intensity": -1.0},
        "c": {"direction": [1, 2, 3], "type": "directional"},
    }
    write_json(root / "configs/lighting/sun.lighting_config.json", {"lights": lamps})
    write_scene(root, tiny_scene() | {"default_lighting": "lighting/sun"})
    (lamp,) = read(root).lights
    # y-up (1, 2, 3) is z-up (1, -3, 2); colour times 2.
    assert np.allclose(lamp.position_m, (1, -3, 2))
    assert lamp.color == (2.0, 1.0, 0.0)


# Bad input -------------------------------------------------------------------------------------


def test_a_folder_without_datasets_scenes_or_objects_is_refused(tmp_path):
    with pytest.raises(DatasetError, match=rf"{tmp_path}: .*scene_dataset_config"):
        SceneDataset(tmp_path)
    with pytest.raises(DatasetError, match="002_master_chef_can"):
        load_objects(tmp_path)
    with pytest.raises(UnknownNameError, match="nowhere"):
        load_objects(tmp_path / "nowhere")
    write_json(tmp_path / "x.scene_dataset_config.json", {})
    with pytest.raises(DatasetError, match="holds no"):
        SceneDataset(tmp_path)


def test_unknown_names_give_the_nearest(root):
    with pytest.raises(UnknownNameError, match=r"'apartmant'.*Did you mean 'apartment'"):
        resolve_dataset("apartmant")
    with pytest.raises(UnknownNameError, match=f"Did you mean '{SCENE}'"):
        read(root, "v3_sc0_staging_0O")
    dataset = SceneDataset(root)  # one scene, of macro layout sc0: train
    with pytest.raises(UnknownNameError, match="Did you mean 'train'"):
        dataset.scenes_of_split("trian")
    assert dataset.resolve_split("train") == dataset.resolve_split(None) == "train"
    for split in SPLIT_MACROS.keys() - {"train"}:
        with pytest.raises(UnknownNameError, match="Valid: train"):
            dataset.resolve_split(split)
    for kind in ("object_instances", "articulated_object_instances"):
        scene = tiny_scene()
        name = scene[kind][0]["template_name"]
        scene[kind][0]["template_name"] = name + "s"
        file = write_scene(root, scene)
        with pytest.raises(DatasetError, match=rf"{file}: .*'{name}s'.*Did you mean '{name}'"):
            read(root)


def test_damaged_files_are_named(root):
    cube, urdf = root / "objects/cube.glb", root / "urdf/chests/chest.urdf"
    scene = write_scene(root, tiny_scene())
    damaged = bytearray(cube.read_bytes())
    damaged[20:60] = b"\0" * 40  # inside the JSON chunk: the length is right, the content is not
    absent_mesh = DRAWER_URDF.replace("body.glb", "gone.glb")
    gone = json.dumps({"render_asset": "../../objects/cube.glb", "collision_asset": "gone.glb"})
    for file, content, said in (
        (cube, cube.read_bytes()[:-40], r"cube\.glb: truncated"),
        (cube, b"<html>not found</html>", r"cube\.glb: "),
        (cube, bytes(damaged), r"cube\.glb: "),
        (urdf, DRAWER_URDF[:200].encode(), r"chest\.urdf: not a valid URDF"),
        (urdf, absent_mesh.encode(), r"chest\.urdf: names 'gone\.glb'"),
        (scene, scene.read_bytes()[:-30], rf"{scene}: not valid JSON"),
        (root / f"navmeshes/{SCENE}.navmesh", b"none", rf"{SCENE}\.navmesh: not a navmesh"),
        (root / "configs/stages/room.stage_config.json", gone.encode(), r"gone\.glb"),
    ):
        before = file.read_bytes() if file.exists() else None
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(content)
        with pytest.raises(DatasetError, match=said):
            read(root)
        file.unlink() if before is None else file.write_bytes(before)


def test_malformed_scenes_and_templates_are_named(root):
    templates = (
        lambda config: config.pop("render_asset"),
        lambda config: next(iter(config["user_defined"].values())).pop("scale"),
        lambda config: next(iter(config["user_defined"].values())).update(position=[0, math.nan]),
        lambda config: config.update(friction_coefficient="rough"),
    )
    scenes = (
        lambda scene: scene.pop("stage_instance"),
        lambda scene: scene["object_instances"][0].pop("template_name"),
        lambda scene: scene["object_instances"][0].update(translation=[1, "two", 3]),
        lambda scene: scene["object_instances"][0].update(rotation=[0, 0, 0, 0]),
        lambda scene: scene["articulated_object_instances"][0].update(uniform_scale="big"),
    )
    files = [root / TABLE] * len(templates) + [write_scene(root, tiny_scene())] * len(scenes)
    for damage, file in zip((*templates, *scenes), files, strict=True):
        good = file.read_text()
        content = json.loads(good)
        damage(content)
        write_json(file, content)
        with pytest.raises(DatasetError, match=rf"{file}: "):
            read(root)
        file.write_text(good)
