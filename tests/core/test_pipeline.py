"""Optimised copies of datasets: equal in format and content, written atomically."""

import json
import os
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from builders import box_glb
from killed import FOLDER, killed_while_writing
from PIL import Image
from textured import box_at, textured_dataset

from hab_tasks.cli import main
from hab_tasks.errors import DatasetError, HabError
from hab_tasks.files import ASIDE
from hab_tasks.pipeline import optimise
from hab_tasks.pipeline.options import AssetOptions
from hab_tasks.scenes.habitat.dataset import SceneDataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.meshes import mesh_bounds, parts_volume
from hab_tasks.scenes.objects import load_objects


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """Every test computes for itself."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))


def listing(folder: Path) -> dict[str, bytes]:
    files = (p for p in sorted(folder.rglob("*")) if p.is_file())
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


def copy(source: SceneDataset, out: Path, **options: object) -> optimise.Report:
    return optimise.optimise(source, out, AssetOptions(**options))


def test_a_copy_loads_and_says_the_same(tmp_path):
    source = textured_dataset(tmp_path / "source")
    before = listing(source.root)
    report = copy(source, tmp_path / "out")
    assert listing(source.root) == before
    assert report.tally.reused == 0
    light = SceneDataset(tmp_path / "out")
    (old,), (new,) = ([load_scene(d, s) for s in d.scene_files] for d in (source, light))
    assert [o.name for o in new.objects] == [o.name for o in old.objects]
    for a, b in zip(old.objects, new.objects, strict=True):
        assert b.template.visual_file.is_relative_to(light.root)
        assert b.world_from_object == a.world_from_object
        assert b.template.receptacles == a.template.receptacles
        assert (b.template.friction, b.template.up) == (a.template.friction, a.template.up)
    assert new.receptacles == old.receptacles
    table = next(o.template for o in new.objects if o.template.name == "table")
    assert table.mass_kg == 18
    assert table.collision[0].file.is_relative_to(light.root)
    assert (light.root / "LICENSE.txt").read_text() == "Only for tests."
    assert json.loads((light.root / optimise.NOTE).read_text())["copied from"] == "tiny"
    assert not list(light.root.rglob("*.convex.stl"))
    assert report.after.texture_bytes == report.before.texture_bytes / 8
    urdf = tmp_path / "out/urdf/chests/chest.urdf"
    assert "," not in urdf.read_text()
    root = ElementTree.parse(urdf).getroot()
    assert root.find("link/collision/geometry/mesh").get("filename") == "body_coacd.glb"
    # body.glb is a box of 0.4 x 0.3 x 0.2 m.
    assert parts_volume(urdf.with_name("body_coacd.glb")) == pytest.approx(0.024, rel=1e-3)
    assert root.find("link/visual/geometry/mesh").get("filename") == "body.glb"
    assert root.findall("link/collision/geometry/box")[0].get("size") == "0.1 0.1 0.1"


def test_boxes_turn_with_their_mesh(tmp_path):
    source = textured_dataset(tmp_path / "source")
    copy(source, tmp_path / "out", collision="box")
    config = json.loads((tmp_path / "out/configs/objects/table.object_config.json").read_text())
    assert config["use_bounding_box_for_collision"] is True
    assert "collision_asset" not in config
    root = ElementTree.parse(tmp_path / "out/urdf/chests/chest.urdf").getroot()
    # 0.4 x 0.3 x 0.2 m, twice as long; its middle is the mesh's origin.
    assert root.find("link/collision/geometry/box").get("size") == "0.8 0.3 0.2"
    assert root.find("link/collision/origin").get("xyz") == "1 0 0"
    source = textured_dataset(tmp_path / "other")
    off_center = trimesh.Scene(box_at(0.1, 0, 0, size=(0.4, 0.3, 0.2)))
    off_center.export(source.root / "urdf/chests/body.glb", file_type="glb")
    copy(source, tmp_path / "off", collision="box")
    origin = ElementTree.parse(tmp_path / "off/urdf/chests/chest.urdf").find(".//collision/origin")
    # The middle at x = 2 * 0.1 of the mesh lies at y = 0.2, turned by 90 degrees about z.
    assert [float(x) for x in origin.get("xyz").split()] == pytest.approx([1.0, 0.2, 0.0])


def test_a_mass_that_followed_from_the_volume_stays(tmp_path):
    source = textured_dataset(tmp_path / "source")
    file = source.object_files["table"]
    config = json.loads(file.read_text())
    del config["mass"]
    file.write_text(json.dumps(config))
    copy(source, tmp_path / "out", collision="merged-hull")
    config = json.loads((tmp_path / "out/configs/objects/table.object_config.json").read_text())
    # 500 kg/m3 * 1.0 * 0.8 * 0.6 m3
    assert config["mass"] == pytest.approx(240.0, rel=1e-4)


def test_a_second_run_computes_only_what_depends_on_other_options(tmp_path):
    source = textured_dataset(tmp_path / "source")
    first = copy(source, tmp_path / "out")
    again = copy(source, tmp_path / "again")
    assert (again.tally.computed, again.tally.reused) == (0, first.tally.computed)
    assert listing(tmp_path / "again") == listing(tmp_path / "out")
    hulls = copy(source, tmp_path / "hulls", collision="hull")
    # table and chest have parts; three visual meshes (table, cube, chest) are as they were
    assert (hulls.tally.computed, hulls.tally.reused) == (2, 3)


def test_a_failure_names_the_file_and_keeps_what_was_computed(tmp_path):
    source = textured_dataset(tmp_path / "source")
    body = source.root / "urdf/chests/body.glb"
    good = body.read_bytes()
    body.write_bytes(good.replace(b"POSITION", b"POSITIVE"))
    with pytest.raises(DatasetError, match=r"body\.glb: .*POSITION"):
        copy(source, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.glob(".*"))
    # Two objects' visual meshes and the table's parts came before it.
    assert copy(textured_dataset(tmp_path / "mended"), tmp_path / "out").tally.reused == 3


def test_a_run_killed_while_it_writes_leaves_no_half_copy(tmp_path, monkeypatch):
    source = textured_dataset(tmp_path / "source")
    killed_while_writing(FOLDER, tmp_path / "out")
    assert len(list(tmp_path.glob(f"{ASIDE}*"))) == 1

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(optimise.shutil, "copyfile", killed)
        with pytest.raises(KeyboardInterrupt):
            copy(source, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert copy(source, tmp_path / "out").tally.computed == 0
    assert not list(tmp_path.glob(f"{ASIDE}*"))
    assert not (tmp_path / "out/half").exists()


def test_force_replaces_datasets_and_nothing_else(tmp_path):
    source = textured_dataset(tmp_path / "source")
    copy(source, tmp_path / "out")
    (tmp_path / "out/extra").write_text("")
    with pytest.raises(HabError, match="--force"):
        copy(source, tmp_path / "out")
    optimise.optimise(source, tmp_path / "out", AssetOptions(), force=True)
    assert not (tmp_path / "out/extra").exists()
    (tmp_path / "home").mkdir()
    (tmp_path / "home/thesis.txt").write_text("precious")
    with pytest.raises(HabError, match=f"contains files but no {optimise.NOTE}"):
        optimise.optimise(source, tmp_path / "home", AssetOptions(), force=True)


def test_the_source_is_never_written_to(tmp_path):
    source = textured_dataset(tmp_path / "source")
    for out in ("source", "source/configs/light", "."):
        with pytest.raises(HabError, match="never"):
            optimise.optimise(source, tmp_path / out, AssetOptions(), force=True)


def test_command_line(tmp_path, capsys):
    textured_dataset(tmp_path / "source")
    arguments = ["assets", str(tmp_path / "source"), "--out", str(tmp_path / "out")]
    arguments += ["--workers", "1"]
    assert main([*arguments, "--collision", "hull"]) == 0
    printed = capsys.readouterr().out
    assert "5 of 5 meshes" in printed
    assert "5 meshes computed, 0 reused" in printed
    # Three boxes of 8 * 56 + 36 * 4 bytes; a sphere that halves to 2,560 triangles, from 210,288 to
    # 106,376 bytes; its texture of 64 * 64 pixels, from 4 bytes each to 1/2: 228448 / 110200.
    assert "memory, counted       2.1 times less" in printed
    assert main(arguments) == 2
    assert "--force" in capsys.readouterr().err
    assert main([*arguments, "--force", "--collision", "cubes"]) == 2
    assert "coacd, hull, merged-hull" in capsys.readouterr().err
    assert main([*arguments, "--force", "--objects", str(tmp_path / "nowhere")]) == 2
    assert "nowhere" in capsys.readouterr().err


@pytest.mark.slow
def test_a_failure_in_a_worker_names_the_file(tmp_path):
    source = textured_dataset(tmp_path / "source")
    box_glb(source.root / "objects/table.glb")
    data = (source.root / "objects/table.glb").read_bytes()
    (source.root / "objects/table.glb").write_bytes(data.replace(b"POSITION", b"POSITIVE"))
    with pytest.raises(DatasetError, match=r"table\.glb"):
        optimise.optimise(source, tmp_path / "out", AssetOptions(), workers=2)


# Real data -------------------------------------------------------------------------------------


@pytest.mark.assets
@pytest.mark.parametrize(
    ("decimate", "triangles"),
    [
        pytest.param(1.0, 16384, marks=pytest.mark.slow),
        pytest.param(0.5, 8192, marks=pytest.mark.long),
    ],
)
def test_a_copy_of_ycb_loads_with_the_same_masses(tmp_path, ycb, decimate, triangles):
    source = textured_dataset(tmp_path / "source")
    folder = tmp_path / "real"
    shutil.copytree(ycb, folder, copy_function=shutil.copyfile)
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


def part_of_replica_cad(source: Path, root: Path, scenes: list[str]) -> SceneDataset:
    """Copies what some layouts need."""
    source = source.resolve()  # may be a link, and the files found below are resolved
    whole = SceneDataset(source)
    files = {p for p in source.iterdir() if p.is_file()}
    files |= {*source.glob("configs/stages/*"), *source.glob("configs/lighting/*")}
    for scene_id in scenes:
        files.add(whole.scene_files[scene_id])
        files |= set(source.glob(f"navmeshes*/{scene_id}.navmesh"))
        data = json.loads(whole.scene_files[scene_id].read_text())
        for entry in data["object_instances"]:
            config = whole.object_files[Path(entry["template_name"]).name]
            fields = json.loads(config.read_text())
            named = (fields.get(key) for key in ("render_asset", "collision_asset"))
            files |= {config, *((config.parent / name).resolve() for name in named if name)}
        for entry in data["articulated_object_instances"]:
            files |= {*whole.urdf_files[Path(entry["template_name"]).name].parent.iterdir()}
    for file in sorted(file for file in files if file.exists()):
        target = root / file.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    return SceneDataset(root)


@pytest.mark.long
@pytest.mark.assets
@pytest.mark.render
def test_real_visuals_need_a_quarter_of_the_memory_and_look_the_same(tmp_path, replica_cad):
    from hab_tasks.pipeline.measure import compare

    scenes = ["apt_2", "v3_sc0_staging_05", "v3_sc2_staging_11"]
    source = part_of_replica_cad(replica_cad, tmp_path / "source", scenes)
    report = optimise.optimise(
        source, tmp_path / "out", AssetOptions(), workers=os.cpu_count() or 1
    )
    found = compare(source, SceneDataset(tmp_path / "out"), views=20)
    assert len(found.depth_difference_m) == 20
    assert found.mean_depth_difference_m <= 0.01
    assert found.original.process_bytes / found.copy.process_bytes >= 4.0
    assert found.original.trimmed_bytes / found.copy.trimmed_bytes >= 4.0
    assert found.original.counted_bytes / found.copy.counted_bytes >= 4.0
    assert report.after.triangles < 0.85 * report.before.triangles
