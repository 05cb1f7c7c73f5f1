"""Reading Habitat's scene dataset format: content, known defects and invalid input."""

import logging
import shutil
import struct

import numpy as np
import pytest
from builders import cpu_scene, table_config, tiny_dataset, tiny_scene, write_json, write_scene

from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.io import cache
from hab_tasks.world.scenes.habitat.dataset import SPLIT_MACROS, SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.pool import BodyPool

SCENE = "v3_sc0_staging_00"
TABLE = "configs/objects/table.object_config.json"


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A tiny dataset, a cache of its own, and nothing said yet."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_said", set())
    return tiny_dataset(tmp_path / "tiny")


def read(root, scene_id=SCENE):
    return load_scene(SceneDataset(root), scene_id)


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
    shutil.copytree(tmp_path / "urdf/chests", other.parent)
    assert read(tmp_path).articulations[0].urdf_file == other.resolve()


def test_bodies_are_built_where_the_scene_says_with_commas_in_urdf_attributes(root):
    handles = BodyPool(cpu_scene(), {}).show(read(root), ())
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
    # The head of a Detour tile: magic, 14 integers, 3 floats, bounds.
    tile = struct.pack("<4s14i9f", b"VAND", *range(14), 0, 0, 0, -3, -0.1, -4, 1, 2, 6)
    (root / f"navmeshes/{SCENE}.navmesh").write_bytes(b"TESM0000" + tile + b"0" * 64)
    with caplog.at_level(logging.WARNING):
        stage = read(root).stage
        read(root)
    assert [r.message.count("stage meshes absent") for r in caplog.records] == [1]
    assert stage.visual_file is None
    floor, *walls = stage.collision
    assert len(walls) == 4
    # y-up: the floor's surface is at y = 0 and covers x -3..1, z -4..6 (plus the walls' 0.1 m).
    assert np.allclose(floor.center_m, (-1, -0.05, 1))
    assert np.allclose(floor.half_size_m, (2.1, 0.05, 5.1))


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
    write_json(root / TABLE, table_config((-0.5, 0.1, -0.3)))
    # uniform_scale of the chest is 2
    entry = {"parent_link": "drawer", "position": [0.1, 0, 0.2], "scale": [0.1, -0.05, 0.2]}
    config = {"user_defined": {"receptacle_aabb_in": entry}}
    write_json(root / "urdf/chests/chest.ao_config.json", config)
    on_table, inside = read(root).receptacles
    assert on_table.half_size_m == (0.5, 0.1, 0.3)
    assert on_table.body == "table_:0000"
    assert on_table.body_from_box == (0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0)
    assert on_table.up == (0.0, 1.0, 0.0)
    assert inside.body == "chest_:0000/drawer"
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


# Bad input; damaged files are tests/faults -----------------------------------------------------


def test_a_folder_without_datasets_scenes_or_objects_is_refused(tmp_path):
    with pytest.raises(DatasetError, match=rf"{tmp_path}: .*scene_dataset_config"):
        SceneDataset(tmp_path)
    with pytest.raises(DatasetError, match="002_master_chef_can"):
        load_objects(tmp_path)
    write_json(tmp_path / "x.scene_dataset_config.json", {})
    with pytest.raises(DatasetError, match="holds no"):
        SceneDataset(tmp_path)


def test_unknown_names_give_the_nearest(root):
    with pytest.raises(UnknownNameError, match=f"Did you mean '{SCENE}'"):
        read(root, "v3_sc0_staging_0O")
    dataset = SceneDataset(root)  # one scene, of macro layout sc0: train
    assert dataset.resolve_split("train") == dataset.resolve_split(None) == "train"
    for split in SPLIT_MACROS.keys() - {"train"}:
        with pytest.raises(UnknownNameError, match="Valid: train"):
            dataset.resolve_split(split)
