"""Oversized layouts, and a few faults in the real ReplicaCAD."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from builders import tiny_scene, write_scene
from faulty_data import Damage, put, read_as_env, refused_everywhere, swap, text, whole_dataset
from refusals import check_each, refused_by_call

from hab_tasks.scenes.habitat.dataset import SceneDataset
from hab_tasks.scenes.habitat.load import MOST_FURNITURE, load_scene


def chests(count: int, step_m: float) -> list[dict]:
    """Pieces of furniture in a row."""
    return [
        {"template_name": "chest", "translation": [step_m * number, 0.2, 5.0]}
        for number in range(count)
    ]


def with_furniture(root, pieces):
    write_scene(root, tiny_scene() | {"articulated_object_instances": pieces})
    return root


def test_too_much_furniture_is_refused(tmp_path):
    root = with_furniture(whole_dataset(tmp_path / "data"), chests(240, 0.0))
    words = ("scene_instance.json", "240 articulated_object_instances", f"{MOST_FURNITURE}")
    refused_by_call(lambda: read_as_env(root), *words)


def test_furniture_in_the_place_of_its_twin_is_refused(tmp_path):
    root = with_furniture(whole_dataset(tmp_path / "data"), chests(2, 1e-5))
    words = ("scene_instance.json", "articulated_object_instances[1]", "chest stands where")
    refused_everywhere(root, *words)


def test_furniture_beside_its_twin_is_read(tmp_path):
    root = with_furniture(whole_dataset(tmp_path / "data"), chests(MOST_FURNITURE, 1.5))
    assert len(read_as_env(root).articulations) == MOST_FURNITURE


def test_many_objects_are_read(tmp_path):
    root = whole_dataset(tmp_path / "data")
    cube = {"template_name": "cube", "motion_type": "STATIC"}
    cubes = [cube | {"translation": [0.2 * k, 0.2, 0]} for k in range(2000)]
    write_scene(root, tiny_scene() | {"object_instances": cubes})
    assert len(read_as_env(root).objects) == 2000


REAL = "v3_sc0_staging_00"
REAL_SCENE = f"configs/scenes/{REAL}.scene_instance.json"

FAULTS: dict[str, tuple[str, Damage, str]] = {
    "scene": (REAL_SCENE, put("object_instances", 3, "translation", value=[0, 1]), "instances[3]"),
    "joint": (
        "urdf/fridge/fridge.urdf",
        swap('type="revolute"', 'type="hinge"'),
        "'hinge'",
    ),
    "mesh": ("urdf/fridge/top_door.glb", text(b"gone"), "not a GLB"),
}


@pytest.mark.assets
def test_a_fault_in_replica_cad_is_named(replica_cad, tmp_path, monkeypatch):
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))

    def check(case):
        name, damage, words = case
        root = Path(tempfile.mkdtemp(dir=tmp_path)) / "replica"
        shutil.copytree(replica_cad.resolve(), root, copy_function=os.symlink)
        content = (root / name).read_bytes()
        (root / name).unlink()
        (root / name).write_bytes(content)
        damage(root / name)
        words = (name.rpartition("/")[2], words)
        refused_by_call(lambda: load_scene(SceneDataset(root), REAL), *words)

    check_each(FAULTS, check)
