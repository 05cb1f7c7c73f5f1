"""Optimised copies of datasets: equal in format and content, written atomically."""

import json
import os
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from hab_authoring.pipeline import optimise
from hab_authoring.pipeline.jobs import AssetOptions
from hab_authoring.pipeline.measure import compare
from PIL import Image
from textured import box_at, textured_dataset

from hab_tasks.errors import DatasetError, HabError
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.meshes import mesh_bounds, parts_volume
from hab_tasks.world.scenes.objects import load_objects


@pytest.fixture
def source(tmp_path, monkeypatch) -> SceneDataset:
    """A dataset to copy, and an empty cache."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    return textured_dataset(tmp_path / "source")


def listing(folder: Path) -> dict[str, bytes]:
    files = (p for p in sorted(folder.rglob("*")) if p.is_file())
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


def copy(source: SceneDataset, out: Path, **options: object) -> optimise.Report:
    return optimise.optimise(source, out, AssetOptions(**options))


def test_a_copy_loads_and_says_the_same(tmp_path, source):
    before = listing(source.root)
    report = copy(source, tmp_path / "out")
    assert listing(source.root) == before
    light = SceneDataset(tmp_path / "out")
    (old,), (new,) = ([load_scene(d, s) for s in d.scene_files] for d in (source, light))
    for a, b in zip(old.objects, new.objects, strict=True):
        assert b.template.visual_file.is_relative_to(light.root)
        assert (b.name, b.world_from_object) == (a.name, a.world_from_object)
        for field in ("receptacles", "friction", "up"):
            assert getattr(b.template, field) == getattr(a.template, field)
    assert new.receptacles == old.receptacles
    table = next(o.template for o in new.objects if o.template.name == "table")
    assert table.mass_kg == 18
    assert table.collision[0].file.is_relative_to(light.root)
    assert (light.root / "LICENSE.txt").read_text() == "Only for tests."
    assert json.loads((light.root / optimise.NOTE).read_text())["copied from"] == "tiny"
    assert not list(light.root.rglob("*.convex.stl"))
    assert report.after.texture_bytes == report.before.texture_bytes / 8
    urdf = light.urdf_files["chest"]
    root = ElementTree.parse(urdf).getroot()
    assert root.find("link/collision/geometry/mesh").get("filename") == "body_coacd.glb"
    # body.glb is a box of 0.4 x 0.3 x 0.2 m.
    assert parts_volume(urdf.with_name("body_coacd.glb")) == pytest.approx(0.024, rel=1e-3)
    assert root.find("link/visual/geometry/mesh").get("filename") == "body.glb"
    assert root.find("link/collision/geometry/box").get("size") == "0.1 0.1 0.1", "no commas"


def test_boxes_turn_with_their_mesh_and_masses_of_volumes_stay(tmp_path, source):
    file = source.object_files["table"]
    config = json.loads(file.read_text())
    file.write_text(json.dumps({key: config[key] for key in config if key != "mass"}))
    off_center = trimesh.Scene(box_at(0.1, 0, 0, size=(0.4, 0.3, 0.2)))
    off_center.export(source.root / "urdf/chests/body.glb", file_type="glb")
    copy(source, tmp_path / "out", collision="box")
    config = json.loads((tmp_path / "out/configs/objects/table.object_config.json").read_text())
    assert config["use_bounding_box_for_collision"] is True
    assert "collision_asset" not in config
    # 500 kg/m3 * 1.0 * 0.8 * 0.6 m3
    assert config["mass"] == pytest.approx(240.0, rel=1e-4)
    collision = ElementTree.parse(tmp_path / "out/urdf/chests/chest.urdf").find("link/collision")
    # 0.4 x 0.3 x 0.2 m, twice as long; the middle at x = 2 * 0.1 of the mesh, whose origin is at
    # x = 1, lies at y = 0.2, turned by 90 degrees about z.
    assert collision.find("geometry/box").get("size") == "0.8 0.3 0.2"
    origin = [float(x) for x in collision.find("origin").get("xyz").split()]
    assert origin == pytest.approx([1.0, 0.2, 0.0])


def test_a_second_run_computes_only_what_depends_on_other_options(tmp_path, source):
    first = copy(source, tmp_path / "out")
    again = copy(source, tmp_path / "again")
    assert first.tally.reused == again.tally.computed == 0
    assert listing(tmp_path / "again") == listing(tmp_path / "out")
    hulls = copy(source, tmp_path / "hulls", collision="hull")
    # table and chest have parts; three visual meshes (table, cube, chest) are as they were
    assert (hulls.tally.computed, hulls.tally.reused) == (2, 3)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_failure_names_the_file_and_keeps_what_was_computed(tmp_path, source, workers):
    body = source.root / "urdf/chests/body.glb"
    body.write_bytes(body.read_bytes().replace(b"POSITION", b"POSITIVE"))
    with pytest.raises(DatasetError, match=r"body\.glb: .*POSITION"):
        optimise.optimise(source, tmp_path / "out", AssetOptions(), workers=workers)
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.glob(".*"))
    if workers == 1:
        # Two objects' visual meshes and the table's parts came before it.
        assert copy(textured_dataset(tmp_path / "mended"), tmp_path / "out").tally.reused == 3


def test_force_replaces_neither_the_source_nor_the_working_directory(tmp_path, source):
    """`test_files.py` has what is replaced."""
    for folder in (tmp_path, source.root):
        (folder / optimise.NOTE).write_text("{}")
    for name, words in {
        "source": "which is never written to",
        "source/configs/light": "which is never written to",
        ".": "which is never replaced",
    }.items():
        with pytest.raises(HabError, match=words):
            optimise.optimise(source, tmp_path / name, AssetOptions(), force=True)


@pytest.mark.assets
@pytest.mark.parametrize(
    ("decimate", "triangles"),
    [
        pytest.param(1.0, 16384, marks=pytest.mark.slow),
        pytest.param(0.5, 8192, marks=pytest.mark.long),
    ],
)
def test_a_copy_of_ycb_loads_with_the_same_masses(tmp_path, source, ycb, decimate, triangles):
    folder = shutil.copytree(ycb, tmp_path / "real", copy_function=shutil.copyfile)
    options = AssetOptions(decimate=decimate)
    optimise.optimise(source, tmp_path / "out", options, workers=2, objects=folder)
    old, new = load_objects(ycb), load_objects(tmp_path / "out" / optimise.OBJECTS_FOLDER)
    assert {n: o.mass_kg for n, o in new.items()} == {n: o.mass_kg for n, o in old.items()}
    for name in old:
        (a,), (b,) = (objects[name].collision for objects in (old, new))
        assert np.allclose(mesh_bounds(a.file), mesh_bounds(b.file), atol=0.002), name
    bowl = tmp_path / "out/ycb/024_bowl/google_16k/textured.obj"
    assert len(trimesh.load_mesh(bowl, process=False).faces) == pytest.approx(triangles, abs=4)
    with Image.open(bowl.with_name("texture_map.jpg")) as image:
        assert max(image.size) == 1024


@pytest.mark.long
@pytest.mark.assets
@pytest.mark.render
def test_real_visuals_need_a_quarter_of_the_memory_and_look_the_same(tmp_path, replica_cad):
    scenes = ("apt_2", "v3_sc0_staging_05", "v3_sc2_staging_11")
    shutil.copytree(replica_cad, tmp_path / "source", copy_function=shutil.copyfile)
    source = SceneDataset(tmp_path / "source")
    for scene in source.scene_files.keys() - set(scenes):
        source.scene_files[scene].unlink()
    source, out = SceneDataset(source.root), tmp_path / "out"
    workers = os.cpu_count() or 1
    report = optimise.optimise(source, out, AssetOptions(), workers=workers)
    found = compare(source, SceneDataset(out), views=20)
    assert len(found.depth_difference_m) == 20
    assert found.mean_depth_difference_m <= 0.01
    for kind in ("process_bytes", "trimmed_bytes", "counted_bytes"):
        assert getattr(found.original, kind) / getattr(found.copy, kind) >= 4.0, kind
    assert report.after.triangles < 0.85 * report.before.triangles
