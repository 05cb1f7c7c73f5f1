"""`hab-tasks check`: help page, checked files, and faults of layouts."""

import re
import socket

import pytest
from builders import box_glb, table_config, tiny_dataset, tiny_scene, write_json, write_scene
from refusals import refused_by_command

from hab_tasks.cli import main
from hab_tasks.commands import download
from hab_tasks.episodes.layout_report import check_layouts, layout_faults
from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.scenes.habitat import dataset as dataset_module
from hab_tasks.scenes.habitat.dataset import (
    MANISKILL_ASSETS,
    SceneDataset,
    resolve_dataset,
    resolve_objects,
)
from hab_tasks.scenes.habitat.inventory import COMPLETE, absent_objects, take_inventory


@pytest.fixture
def tiny(tmp_path):
    return tiny_dataset(tmp_path / "tiny")


@pytest.fixture
def asset_dir(tmp_path, monkeypatch):
    """An empty folder in place of ManiSkill's downloads."""
    for module in (dataset_module, download):
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


# The page --------------------------------------------------------------------------------------


def test_check_tells_what_is_there(run, tiny):
    write_scene(tiny, tiny_scene(), "v3_sc0_staging_07")
    write_scene(tiny, tiny_scene(), "apt_2")
    write_scene(tiny, tiny_scene(), "garage")
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
    assert found["Present: stage meshes"] == "0 of 1"
    assert found["Present: licence"].endswith("LICENSE.txt: Free for all")


def test_check_tells_what_is_missing_and_what_is_done_about_it(run, tiny):
    (tiny / "objects/cube.glb").unlink()
    chair = {"render_asset": "../../objects/table.glb", "collision_asset": "gone.glb"}
    write_json(tiny / "configs/objects/chair.object_config.json", chair)
    found = page(run("check", tiny))
    assert found["Missing: object meshes"] == "cube (1 layouts) -> skipped"
    assert found["Missing: stage meshes"].startswith("room -> floor and walls are boxes")
    assert found["Missing: convex parts"] == "chair -> their bounding boxes collide"
    assert found["Missing: layouts"].startswith("110 of 111: apt_0 to 5, v3_sc0_staging_01 to 20,")
    splits = "val, test -> rejected by --split; without --split, train is used"
    assert found["Missing: splits"] == splits
    assert "no LICENSE" in found["Missing: licence"]


def test_a_complete_dataset_misses_nothing(run, tiny):
    # 6 apt, 5 macro layouts with 20 micro-variations each: 6 + 5 * 21 = 111
    assert len(set(COMPLETE)) == 111
    for scene_id in COMPLETE:
        write_scene(tiny, tiny_scene(), scene_id)
    box_glb(tiny / "stages/room.glb")
    (tiny / "LICENSE").write_text("Free")
    done = run("check", tiny)
    assert page(done)["Missing: nothing"] == "complete"
    assert "train 63, val 21, test 21; 5 macro, 100 micro-variations, 6 apt" in done.stdout


def test_check_of_the_embedded_dataset(run):
    found = page(run("check", "apartment"))
    assert re.match(
        r"\d+ templates in \d+ categories, and 13 that tasks move", found["Present: objects"]
    )
    assert found["Present: licence"].endswith("Licences of the assets")
    assert "Missing: stage meshes" not in found
    assert "Missing: object meshes" not in found


def test_check_stops_at_a_damaged_file(tiny):
    file = tiny / "objects/table.glb"
    file.write_bytes(file.read_bytes()[:-40])
    refused_by_command(main, ["check", tiny], "table.glb: truncated")


def test_lacking_ycb_objects_are_listed(run, tiny, tmp_path):
    for name in ALL_OBJECTS[2:]:
        (tmp_path / "ycb" / name).mkdir(parents=True)
    assert absent_objects(tmp_path / "ycb") == list(ALL_OBJECTS[:2])
    found = page(run("check", tiny, "--objects", tmp_path / "ycb"))
    wanted = f"{ALL_OBJECTS[0]}, {ALL_OBJECTS[1]} -> the folder is rejected"
    assert found["Missing: YCB objects"] == wanted


@pytest.mark.long
@pytest.mark.assets
def test_check_of_the_real_data(run, data):
    found = page(run("check", data / "replica_cad", "--objects", data / "ycb"))
    wanted = "69: train 63, val 0, test 0; 3 macro, 60 micro-variations, 5 apt, 1 other"
    assert found["Present: layouts"] == wanted
    assert found["Present: objects"] == "92 templates in 41 categories"
    assert "CC BY-NC 4.0" in found["Present: licence"]
    absent = "43 of 111: apt_5, v3_sc3_staging_00 to 20, v3_sc4_staging_00 to 20"
    assert found["Missing: layouts"].startswith(absent)
    assert "bike_01 (47 layouts)" in found["Missing: object meshes"]
    assert "boxes made from the navmesh" in found["Missing: stage meshes"]
    assert "013_apple 0.068 kg" in found["Present: YCB objects"]


# Where ManiSkill downloads to -------------------------------------------------------------------


def test_maniskill_knows_the_assets_by_these_names():
    from mani_skill.utils import download_asset

    for asset, (place, _) in MANISKILL_ASSETS.items():
        assert download_asset.DATA_SOURCES[asset].target_path == place


def test_names_stand_for_what_maniskill_downloaded(asset_dir):
    root = tiny_dataset(asset_dir / "scene_datasets/replica_cad_dataset").resolve()
    assert [resolve_dataset(name).root for name in ("replica_cad", "ReplicaCAD")] == [root, root]
    folder = asset_dir / "assets/mani_skill2_ycb"
    (folder / "models").mkdir(parents=True)
    assert resolve_objects("ycb") == folder


def test_a_folder_of_that_name_comes_first(asset_dir, tmp_path, monkeypatch):
    tiny_dataset(asset_dir / "scene_datasets/replica_cad_dataset")
    root = tiny_dataset(tmp_path / "here/replica_cad")
    monkeypatch.chdir(root.parent)
    assert resolve_dataset("replica_cad").root == root.resolve()


def test_an_absent_dataset_names_maniskills_command(asset_dir):
    (asset_dir / "scene_datasets/replica_cad_dataset/rearrange").mkdir(parents=True)
    command = r"python -m mani_skill\.utils\.download_asset "
    with pytest.raises(DatasetError, match=f"{command}ReplicaCAD"):
        resolve_dataset("replica_cad")
    with pytest.raises(DatasetError, match=f"{command}ycb"):
        resolve_objects("ycb")
    with pytest.raises(UnknownNameError, match="PATH of a ReplicaCAD folder, apartment, replica_"):
        resolve_dataset("/nowhere/replica_cad")


ABSENT = (
    ("check", "replica_cad"),
    ("check", "apartment", "--objects", "ycb"),
    ("episodes", "--env", "HabPick-v1", "--objects", "ycb", "--out", "x.json"),
    ("figures", "ReplicaCAD", "--out", "x"),
)


def test_nothing_is_downloaded_as_a_side_effect(asset_dir, monkeypatch):
    def refuse(*arguments, **options):
        pytest.fail("a connection was opened")

    for name in ("connect", "connect_ex"):
        monkeypatch.setattr(socket.socket, name, refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    for arguments in ABSENT:
        refused_by_command(main, arguments, "python -m mani_skill.utils.download_asset")
    assert not asset_dir.exists()


@pytest.fixture
def maniskill(monkeypatch):
    """Calls of ManiSkill's download function, which downloads nothing here."""
    from mani_skill.utils import download_asset

    calls = []

    def fake(source, verbose=True, non_interactive=True):
        calls.append((source, non_interactive))
        if fake.error is not None:
            raise fake.error
        tiny_dataset(fake.root)

    fake.error, fake.calls, fake.root = None, calls, None
    monkeypatch.setattr(download_asset, "download", fake)
    return fake


def test_download_on_request(run, asset_dir, maniskill):
    from mani_skill.utils import download_asset

    maniskill.root = asset_dir / "scene_datasets/replica_cad_dataset"
    done = run("check", "replica_cad", "--download")
    assert done.returncode == 0, done.stderr
    assert str(maniskill.root) in done.stdout
    assert maniskill.calls == [(download_asset.DATA_SOURCES["ReplicaCAD"], True)]
    run("check", "replica_cad", "--download")
    assert len(maniskill.calls) == 1, "it was there already"


def test_download_never_deletes_what_is_there(asset_dir, maniskill):
    (asset_dir / "scene_datasets/replica_cad_dataset/rearrange").mkdir(parents=True)
    refused_by_command(main, ["check", "replica_cad", "--download"], "would delete")
    assert not maniskill.calls


def test_a_download_that_fails_is_one_line(asset_dir, maniskill):
    maniskill.error = OSError("no route to host")
    place = f"could not be downloaded to {asset_dir}/scene_datasets/replica_cad_dataset"
    refused_by_command(main, ["check", "replica_cad", "--download"], f"{place}: no route to host")


# Trying layouts ---------------------------------------------------------------------------------


def with_scene(root, **changes):
    write_scene(root, tiny_scene() | changes)
    return SceneDataset(root)


def thing(template, translation, motion_type="STATIC"):
    return {"template_name": template, "translation": translation, "motion_type": motion_type}


def kinds(faults):
    return {fault.partition(":")[0] for fault in faults}


def test_a_drawer_that_something_pushes_open_is_unstable(tiny):
    # The chest, of twice its size, has its body at x -1.4 to -0.6 and its drawer at -0.5 to -0.3.
    # A table at -1.46 to -0.46 pushes that drawer 4 cm outwards; everything else stands.
    root = with_scene(tiny, object_instances=[thing("table", [-0.96, 0.4, 0])])
    (fault,) = (f for f in layout_faults(root, "v3_sc0_staging_00") if f.startswith("unstable"))
    moved_m = float(re.search(r"chest_:0000/drawer moves by ([\d.]+) m in 2 s", fault)[1])
    assert 0.03 < moved_m <= 0.25


def test_what_falls_out_of_the_room_is_named(tiny):
    # The shell's floor ends at x = 4.60 m and its wall is 0.1 m thick.
    root = with_scene(tiny, object_instances=[thing("cube", [6, 1, 0], "DYNAMIC")])
    faults = layout_faults(root, "v3_sc0_staging_00")
    (fault,) = (f for f in faults if "cube" in f)
    # It falls for the 5 s in which the others settle: 9.81 / 2 * 5^2 = 122.6 m, from 1 m above.
    fallen_m = float(re.fullmatch(r"fallen: cube_:0000 is ([\d.]+) m under the floor", fault)[1])
    assert fallen_m == pytest.approx(121.6, rel=0.01)


def test_a_layout_that_does_not_load_is_a_fault(tiny):
    root = with_scene(tiny, object_instances=[thing("table9", [0, 0, 0])])
    (fault,) = layout_faults(root, "v3_sc0_staging_00")
    assert fault.startswith("does not load: ")
    assert "Did you mean 'table'" in fault


def test_simulate_prints_faults_and_ends_with_status_1(run, tiny):
    write_scene(tiny, tiny_scene(), "v3_sc0_staging_01")
    bad = tiny_scene() | {"object_instances": [thing("cube", [6, 1, 0], "DYNAMIC")]}
    write_scene(tiny, bad, "v3_sc0_staging_02")
    scenes = "v3_sc0_staging_01,v3_sc0_staging_02"
    done = run("check", tiny, "--simulate", "--workers", 1, "--scenes", scenes)
    assert done.returncode == 1
    found = page(done)
    assert found["Faults: v3_sc0_staging_02"].startswith("fallen: cube_:0000 is")
    assert "v3_sc0_staging_00" not in done.stdout
    assert "of 2 layouts settle" in found["Tried: passed"]
    assert found["Tried: fallen"] == "in 1 layouts"
    assert "Tried: unstable" not in found


def test_bad_options_are_refused(tiny):
    for options, words in (
        (("--simulate", "--scenes", "v3_sc0_staging_0"), "Did you mean 'v3_sc0_staging_00'"),
        (("--download",), "replica_cad"),
    ):
        assert refused_by_command(main, ["check", tiny, *options], words).out == ""


@pytest.mark.slow
def test_two_processes_find_what_one_finds(tiny):
    write_scene(tiny, tiny_scene(), "v3_sc0_staging_01")
    root = with_scene(tiny, object_instances=[thing("cube", [6, 1, 0], "DYNAMIC")])
    scenes = ["v3_sc0_staging_01", "v3_sc0_staging_00"]
    assert list(check_layouts(root, scenes, 2)) == list(check_layouts(root, scenes, 1))


@pytest.mark.slow
@pytest.mark.assets
def test_a_real_layout_loads_and_settles(replica_cad):
    ((_, faults),) = check_layouts(SceneDataset(replica_cad), ["v3_sc1_staging_05"], 1)
    assert not kinds(faults) & {"does not load", "unstable", "fallen"}


@pytest.mark.long
@pytest.mark.assets
def test_every_real_layout_loads_and_nearly_all_settle(replica_cad):
    dataset = SceneDataset(replica_cad)
    scenes = [s for s in dataset.scene_files if s in COMPLETE]
    assert len(scenes) == 63 + 5
    faults = dict(check_layouts(dataset, scenes, 2))
    assert not [s for s, found in faults.items() if "does not load" in kinds(found)]
    # An umbrella, a drawer and a sliding door: furniture that published layouts push apart.
    assert len([s for s, found in faults.items() if kinds(found) & {"unstable", "fallen"}]) <= 5


def test_inventory_reads_every_layout(tiny):
    write_scene(tiny, tiny_scene() | {"stage_instance": {"template_name": "hall"}}, "apt_1")
    found = take_inventory(SceneDataset(tiny))
    assert found.layouts == ("apt_1", "v3_sc0_staging_00")
    assert found.stages == found.absent_stages == ("hall", "room")
