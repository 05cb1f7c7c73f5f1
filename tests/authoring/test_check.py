"""`hab-tasks check`: the page, checked files, and faults of layouts."""

import re
import socket

import pytest
from builders import table_config, tiny_dataset, tiny_scene, write_json, write_scene
from hab_authoring.commands import check
from hab_authoring.inventory import COMPLETE
from hab_authoring.layouts.report import check_layouts, layout_faults
from refusals import refused_by_command

from hab_tasks.cli import main
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.world.scenes.habitat import dataset as dataset_module
from hab_tasks.world.scenes.habitat.dataset import SceneDataset


@pytest.fixture
def tiny(tmp_path):
    return tiny_dataset(tmp_path / "tiny")


@pytest.fixture
def asset_dir(tmp_path, monkeypatch):
    """An empty folder in place of ManiSkill's downloads."""
    for module in (dataset_module, check):
        monkeypatch.setattr(module, "ASSET_DIR", tmp_path / "assets")
    return tmp_path / "assets"


def page(done):
    """The page of a check that went well, as label -> what is said, line breaks taken out."""
    assert done.returncode in (0, 1), done.stderr
    found, part = {}, ""
    for line in done.stdout.splitlines():
        entry = re.match(r"  (\S.*?) {2,}(\S.*)", line)
        if line and not line.startswith(" "):
            part = line
        elif entry:
            label = f"{part}: {entry[1]}"
            found[label] = entry[2]
        elif line.strip():
            found[label] += " " + line.strip()
    return found


def test_check_tells_what_is_there(run, tiny):
    for scene_id in ("v3_sc0_staging_07", "apt_2"):
        write_scene(tiny, tiny_scene(), scene_id)
    write_scene(tiny, tiny_scene() | {"stage_instance": {"template_name": "hall"}}, "garage")
    (tiny / "LICENSE.txt").write_text("\nFree for all\nwithout warranty\n")
    config = table_config() | {"user_defined": {"category": "table"}}
    write_json(tiny / "configs/objects/desk.object_config.json", config)
    found = page(run("check", tiny))
    wanted = "4: train 2, val 0, test 0; 1 macro, 1 micro-variations, 1 apt, 1 other"
    assert found["Present: layouts"] == wanted
    # table, cube and desk; only the desk has a category; the cube collides as its box
    assert found["Present: objects"] == "3 templates in 1 categories"
    assert found["Present: collision"] == "2 templates with convex parts, 1 as boxes"
    assert found["Present: furniture"] == "1 with joints: chest"
    assert found["Present: receptacles"] == "1 names"
    assert found["Present: navmeshes"] == "0 of 4 layouts"
    assert found["Present: stage meshes"] == "0 of 2"
    assert found["Present: licence"].endswith("LICENSE.txt: Free for all")


def test_check_tells_what_is_missing_and_what_is_done_about_it(run, tiny, tmp_path):
    (tiny / "objects/cube.glb").unlink()
    chair = {"render_asset": "../../objects/table.glb", "collision_asset": "gone.glb"}
    write_json(tiny / "configs/objects/chair.object_config.json", chair)
    for name in ALL_OBJECTS[2:]:
        (tmp_path / "ycb" / name).mkdir(parents=True)
    found = page(run("check", tiny, "--objects", tmp_path / "ycb"))
    wanted = f"{ALL_OBJECTS[0]}, {ALL_OBJECTS[1]} -> the folder is rejected"
    assert found["Missing: YCB objects"] == wanted
    assert found["Missing: object meshes"] == "cube (1 layouts) -> skipped"
    assert found["Missing: stage meshes"].startswith("room -> floor and walls are boxes")
    assert found["Missing: convex parts"] == "chair -> their bounding boxes collide"
    assert found["Missing: layouts"].startswith("110 of 111: apt_0 to 5, v3_sc0_staging_01 to 20,")
    splits = "val, test -> rejected by --split; without --split, train is used"
    assert found["Missing: splits"] == splits
    assert "no LICENSE" in found["Missing: licence"]


def test_an_absent_dataset_names_maniskills_command_and_nothing_is_downloaded(
    asset_dir, monkeypatch
):
    def refuse(*arguments, **options):
        pytest.fail("a connection was opened")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    (asset_dir / "scene_datasets/replica_cad_dataset/rearrange").mkdir(parents=True)
    before, command = sorted(asset_dir.rglob("*")), "python -m mani_skill.utils.download_asset"
    for line, asset in {
        "check apartment --objects ycb": "ycb",
        "figures ReplicaCAD --out x": "ReplicaCAD",
    }.items():
        refused_by_command(main, line.split(), f"{command} {asset}")
    assert sorted(asset_dir.rglob("*")) == before
    words = "PATH of a ReplicaCAD folder, apartment, replica_"
    refused_by_command(main, ["check", "/nowhere/replica_cad"], words)


def faults_with(root, template, translation, motion_type):
    """Faults of the tiny layout with one other object in place of its table and cube."""
    thing = {"template_name": template, "translation": translation, "motion_type": motion_type}
    write_scene(root, tiny_scene() | {"object_instances": [thing]})
    return layout_faults(SceneDataset(root), "v3_sc0_staging_00")


OUTSIDE = ("cube", [6, 1, 0], "DYNAMIC")
"""The shell's floor ends at x = 4.60 m and its wall is 0.1 m thick."""


def test_a_drawer_that_something_pushes_open_and_an_unknown_template_are_faults(tiny):
    # The chest, of twice its size, has its body at x -1.4 to -0.6 and its drawer at -0.5 to -0.3.
    # A table at -1.46 to -0.46 pushes that drawer 4 cm outwards; everything else stands.
    faults = faults_with(tiny, "table", [-0.96, 0.4, 0], "STATIC")
    (fault,) = (f for f in faults if f.startswith("unstable"))
    moved_m = float(re.search(r"chest_:0000/drawer moves by ([\d.]+) m in 2 s", fault)[1])
    assert 0.03 < moved_m <= 0.25
    (fault,) = faults_with(tiny, "table9", [0, 0, 0], "STATIC")
    assert fault.startswith("does not load: ")


def test_what_falls_out_of_the_room_is_told_with_status_1(run, tiny):
    (fault,) = (f for f in faults_with(tiny, *OUTSIDE) if "cube" in f)
    # It falls for the 5 s in which the others settle: 9.81 / 2 * 5^2 = 122.6 m, from 1 m above.
    fallen_m = float(re.fullmatch(r"fallen: cube_:0000 is ([\d.]+) m under the floor", fault)[1])
    assert fallen_m == pytest.approx(121.6, rel=0.01)
    for scene_id in ("v3_sc0_staging_01", "v3_sc0_staging_02"):
        write_scene(tiny, tiny_scene(), scene_id)
    command = ("check", tiny, "--simulate", "--workers", 1, "--scenes")
    done = run(*command, "v3_sc0_staging_00,v3_sc0_staging_02")
    assert done.returncode == 1
    found = page(done)
    assert found["Faults: v3_sc0_staging_00"].startswith("fallen: cube_:0000 is")
    assert "v3_sc0_staging_01" not in done.stdout
    assert "of 2 layouts settle" in found["Tried: passed"]
    words = "Did you mean 'v3_sc0"
    assert refused_by_command(main, [*command, "v3_sc0_staging_0"], words).out == ""


@pytest.mark.long
@pytest.mark.assets
def test_every_real_layout_loads_and_nearly_all_settle(replica_cad):
    dataset = SceneDataset(replica_cad)
    scenes = [s for s in dataset.scene_files if s in COMPLETE]
    assert len(scenes) == 63 + 5
    found = [" ".join(faults) for _, faults in check_layouts(dataset, scenes, 2)]
    assert not [faults for faults in found if "does not load:" in faults]
    # An umbrella, a drawer and a sliding door: furniture that published layouts push apart.
    assert sum("unstable:" in faults or "fallen:" in faults for faults in found) <= 5
