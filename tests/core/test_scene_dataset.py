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


def test_a_bounding_box_collides_where_the_config_asks_for_it(root):
    box = read(root).objects[1].template.collision[0]
    assert box.kind == "box"
    assert np.allclose(box.half_size_m, (0.05, 0.1, 0.15))


@pytest.mark.parametrize("urdf_file", ["chests/chest.urdf", "chest/chest.urdf"])
def test_both_folder_layouts_find_the_urdf(tmp_path, urdf_file):
    spec = read(tiny_dataset(tmp_path, urdf_file=urdf_file))
    assert spec.articulations[0].urdf_file == (tmp_path / "urdf" / urdf_file).resolve()


def test_a_urdf_in_a_folder_of_its_own_name_comes_first(root):
    other = root / "urdf/chest/chest.urdf"
    other.parent.mkdir()
    other.write_text(DRAWER_URDF.replace('filename="body.glb"', 'filename="../chests/body.glb"'))
    assert read(root).articulations[0].urdf_file == other.resolve()


def test_commas_in_urdf_attributes_build(root):
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


def test_built_bodies_stand_where_the_scene_says(root):
    scene = cpu_scene()
    handles = BodyPool(scene, {}).show(read(root), ())
    scene._setup(enable_gpu=False)
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


def test_a_damaged_navmesh_is_named(root):
    (root / "navmeshes").mkdir()
    (root / f"navmeshes/{SCENE}.navmesh").write_bytes(b"nothing of the kind")
    with pytest.raises(DatasetError, match=rf"{SCENE}\.navmesh: not a navmesh"):
        read(root)


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


def test_a_stage_collision_mesh_that_is_absent_is_named(root):
    trimesh.Scene(trimesh.creation.box()).export(root / "objects/room.glb")
    config = {"render_asset": "../../objects/room.glb", "collision_asset": "../../stages/gone.glb"}
    write_json(root / "configs/stages/room.stage_config.json", config)
    with pytest.raises(DatasetError, match=r"gone\.glb"):
        read(root)


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
    config = table_config() | {"collision_asset": "../../objects/convex/none.glb"}
    write_json(root / TABLE, config)
    (source,) = read(root).objects[0].template.collision
    assert source.kind == "box"
    assert np.allclose(source.half_size_m, (0.5, 0.4, 0.3))


@pytest.mark.parametrize("scale", [(0.5, 0.1, 0.3), (-0.5, 0.1, -0.3), (0.5, -0.1, 0.3)])
def test_receptacle_scale_is_half_extents_and_may_be_negative(root, scale):
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


def test_an_empty_folder_is_no_dataset(tmp_path):
    with pytest.raises(DatasetError, match=rf"{tmp_path}: .*scene_dataset_config"):
        SceneDataset(tmp_path)


def test_a_dataset_without_scenes_is_refused(tmp_path):
    write_json(tmp_path / "x.scene_dataset_config.json", {})
    with pytest.raises(DatasetError, match="holds no"):
        SceneDataset(tmp_path)


def test_a_folder_that_is_not_there_names_the_nearest():
    with pytest.raises(UnknownNameError, match=r"'apartmant'.*Did you mean 'apartment'"):
        resolve_dataset("apartmant")


def test_an_unknown_scene_names_the_nearest(root):
    with pytest.raises(UnknownNameError, match=f"Did you mean '{SCENE}'"):
        read(root, "v3_sc0_staging_0O")


def test_an_unknown_split_names_the_nearest(root):
    with pytest.raises(UnknownNameError, match="Did you mean 'train'"):
        SceneDataset(root).scenes_of_split("trian")


@pytest.mark.parametrize("split", SPLIT_MACROS)
def test_only_splits_with_scenes_resolve(root, split):
    dataset = SceneDataset(root)  # one scene, of macro layout sc0: train
    if split == "train":
        assert dataset.resolve_split(split) == dataset.resolve_split(None) == "train"
        return
    with pytest.raises(UnknownNameError, match="Valid: train"):
        dataset.resolve_split(split)


def test_a_truncated_glb_is_named(root):
    file = root / "objects/table.glb"
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(DatasetError, match=r"table\.glb: truncated"):
        read(root)


@pytest.mark.parametrize("content", [b"", b"<html>not found</html>"])
def test_a_glb_that_is_none_is_named(root, content):
    (root / "objects/table.glb").write_bytes(content)
    with pytest.raises(DatasetError, match=r"table\.glb: "):
        read(root)


def test_a_glb_with_damaged_content_is_named(root):
    file = root / "objects/cube.glb"
    data = bytearray(file.read_bytes())
    data[20:60] = b"\0" * 40  # inside the JSON chunk: the length is right, the content is not
    file.write_bytes(data)
    with pytest.raises(DatasetError, match=r"cube\.glb: "):
        read(root)


def test_a_urdf_that_does_not_parse_is_named(root):
    (root / "urdf/chests/chest.urdf").write_text(DRAWER_URDF[:200])
    with pytest.raises(DatasetError, match=r"chest\.urdf: not a valid URDF"):
        read(root)


def test_a_urdf_without_its_mesh_names_both(root):
    (root / "urdf/chests/body.glb").unlink()
    with pytest.raises(DatasetError, match=r"chest\.urdf: names 'body\.glb'"):
        read(root)


@pytest.mark.parametrize("kind", ["object_instances", "articulated_object_instances"])
def test_a_scene_naming_a_missing_template_gives_the_nearest(root, kind):
    scene = tiny_scene()
    name = scene[kind][0]["template_name"]
    scene[kind][0]["template_name"] = name + "s"
    file = write_scene(root, scene)
    with pytest.raises(DatasetError, match=rf"{file}: .*'{name}s'.*Did you mean '{name}'"):
        read(root)


def test_a_scene_that_is_not_json_is_named(root):
    file = write_scene(root, tiny_scene())
    file.write_text(json.dumps(tiny_scene())[:-30])
    with pytest.raises(DatasetError, match=rf"{file}: not valid JSON"):
        read(root)


@pytest.mark.parametrize(
    "damage",
    [
        lambda scene: scene.pop("stage_instance"),
        lambda scene: scene["object_instances"][0].pop("template_name"),
        lambda scene: scene["object_instances"][0].update(translation=[1, "two", 3]),
        lambda scene: scene["object_instances"][0].update(rotation=[0, 0, 0, 0]),
        lambda scene: scene["articulated_object_instances"][0].update(uniform_scale="big"),
    ],
    ids=["no stage", "no template", "odd translation", "zero rotation", "odd scale"],
)
def test_a_malformed_scene_is_named(root, damage):
    scene = tiny_scene()
    damage(scene)
    file = write_scene(root, scene)
    with pytest.raises(DatasetError, match=rf"{file}: "):
        read(root)


@pytest.mark.parametrize(
    "damage",
    [
        lambda config: config.pop("render_asset"),
        lambda config: next(iter(config["user_defined"].values())).pop("scale"),
        lambda config: next(iter(config["user_defined"].values())).update(position=[0, math.nan]),
        lambda config: config.update(friction_coefficient="rough"),
    ],
    ids=["no asset", "no scale", "odd position", "odd friction"],
)
def test_a_malformed_template_is_named(root, damage):
    config = table_config()
    damage(config)
    file = write_json(root / TABLE, config)
    with pytest.raises(DatasetError, match=rf"{file}: "):
        read(root)


def test_an_objects_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(UnknownNameError, match="nowhere"):
        load_objects(tmp_path / "nowhere")


def test_an_objects_folder_without_an_object_names_it(tmp_path):
    with pytest.raises(DatasetError, match="002_master_chef_can"):
        load_objects(tmp_path)
