"""The real ReplicaCAD and YCB: read as they are, and never modified."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from hab_tasks.articulations import HANDLE_MARKERS
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.receptacles import PLACE_RECEPTACLES, UNSEEN_RECEPTACLES
from hab_tasks.world.scenes.habitat.dataset import SPLIT_MACROS, SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.objects import load_objects

pytestmark = pytest.mark.assets
BIKES = {"frl_apartment_bike_01", "frl_apartment_bike_02"}


@pytest.fixture(scope="module")
def dataset(replica_cad):
    return SceneDataset(replica_cad)


@pytest.fixture(scope="module")
def specs(dataset):
    return {scene_id: load_scene(dataset, scene_id) for scene_id in dataset.scene_files}


def listing(folder: Path) -> dict[Path, tuple[int, int]]:
    """Every file's and folder's time of change and size."""
    stats = {path: path.stat() for path in folder.rglob("*")}
    return {path: (stat.st_mtime_ns, stat.st_size) for path, stat in stats.items()}


def test_scenes_are_read_and_hold_what_their_files_say(dataset, specs):
    # 21 each of sc0, sc1, sc2, apt_0 to apt_4 and the empty stage
    assert len(specs) == 3 * 21 + 5 + 1
    assert [len(dataset.scenes_of_split(s)) for s in SPLIT_MACROS] == [63, 0, 0]
    for scene_id, spec in specs.items():
        floor = spec.stage.collision[0]
        # ReplicaCAD's flat is some 7 x 13 m.
        assert 3.0 < floor.half_size_m[0] < 4.5
        assert 5.5 < floor.half_size_m[2] < 7.5
        assert np.isfinite([o.world_from_object for o in spec.objects]).all()
        raw = json.loads(dataset.scene_files[scene_id].read_text()).get("object_instances", [])
        names = [Path(o["template_name"]).name for o in raw]
        assert len(spec.objects) == sum(name not in BIKES for name in names)
        loose = [n for o, n in zip(raw, names, strict=True) if o["motion_type"] == "DYNAMIC"]
        assert sum(o.dynamic for o in spec.objects) == sum(name not in BIKES for name in loose)
        if "staging" in scene_id:
            assert 17 <= len(names) <= 21
            assert not loose
            assert len(spec.articulations) == 6
        elif scene_id.startswith("apt"):
            assert len(loose) > 100
    # Only bikes are missing.
    assert {name for spec in specs.values() for name in spec.missing} == BIKES


def test_receptacles_and_handles_of_the_paper_are_there(specs):
    names = {r.name for spec in specs.values() for r in spec.receptacles}
    assert {*PLACE_RECEPTACLES, *UNSEEN_RECEPTACLES} <= names
    furniture = {a.template: a.urdf_file for a in specs["v3_sc0_staging_00"].articulations}
    for marker in HANDLE_MARKERS:
        if marker.template == "fridge_mirrored":
            continue  # the apartment's only
        links = ElementTree.parse(furniture[marker.template]).getroot().iter("link")
        assert marker.link in {link.get("name") for link in links}, marker


@pytest.mark.slow
def test_building_writes_nothing_beside_the_data(data, tmp_path):
    """With a cache of its own, so that everything that is computed is computed now."""
    before = listing(data)
    code = f"""
import gymnasium as gym
env = gym.make("hab_tasks:HabPick-v1", scene_dataset={str(data / "replica_cad")!r},
               objects={str(data / "ycb")!r}, scene="v3_sc0_staging_00", num_episodes=1)
env.reset(seed=0)
env.step(env.action_space.sample())
"""
    env = {**os.environ, "HAB_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert listing(data) == before


def test_ycb_masses_equal_the_urdfs(ycb):
    objects = load_objects(ycb)
    assert tuple(sorted(objects)) == ALL_OBJECTS
    masses = {}
    for file in ycb.glob("*.urdf"):
        text = file.read_text()
        name = re.search(r'filename="(\d{3}_\w+)/', text)[1]
        masses[name] = float(re.search(r'<mass value="([\d.]+)"', text)[1])
    assert {n: o.mass_kg for n, o in objects.items()} == masses
