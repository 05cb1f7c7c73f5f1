"""Faults in a folder of YCB objects, in both layouts, and in a folder of layouts."""

import functools
import json
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from faulty_data import (
    SCENE,
    SCENE_ID,
    cut,
    folder,
    kept_folder,
    pipe,
    put,
    swap,
    text,
    whole_dataset,
)
from hab_authoring.layouts.write import write_layout_set
from PIL import Image
from refusals import check_each, refused_by_call, refused_by_command

from hab_tasks.cli import main
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.world.scenes.habitat.dataset import LayoutSet, SceneDataset, resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.visuals import textured_glb

CAN = ALL_OBJECTS[0]
CAN_URDF = f"""<robot name="can"><link name="can">
<inertial><mass value="0.4"/></inertial>
<collision><geometry><mesh filename="{CAN}/google_16k/textured_vhacd.stl"/></geometry></collision>
</link></robot>"""


@functools.cache
def ycb_template(kind: str) -> Path:
    """A folder of 13 small textured boxes in the layout ``google`` or ``maniskill``."""
    root = kept_folder()
    mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    uv = np.random.default_rng(0).random((len(mesh.vertices), 2))
    picture = Image.new("RGB", (8, 8), (200, 30, 30))
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, image=picture)
    for name in ALL_OBJECTS:
        place = root / name / "google_16k" if kind == "google" else root / "models" / name
        place.mkdir(parents=True)
        mesh.export(place / "textured.obj")
        own = "textured_vhacd.stl" if kind == "google" else "collision.ply"
        trimesh.creation.box((0.1, 0.1, 0.1)).export(place / own)
    (root / "can.urdf").write_text(CAN_URDF)
    info = {name: {"density": 800} for name in ALL_OBJECTS}
    (root / "info_pick_v0.json").write_text(json.dumps(info))
    return root


def ycb_copy(tmp_path: Path, kind: str) -> Path:
    """A copy of such a folder that may be damaged."""
    return shutil.copytree(ycb_template(kind), Path(tempfile.mkdtemp(dir=tmp_path)) / kind)


GARBAGE = text(b"nothing of the kind\n" * 20)


# Kind of folder, file, words of the message (the file's name if None), damages.
STL, OBJ = f"{CAN}/google_16k/textured_vhacd.stl", f"{CAN}/google_16k/textured.obj"
PLY, INFO = f"models/{CAN}/collision.ply", "info_pick_v0.json"
IN_FOLDER = (
    ("google", STL, None, (text(b""), GARBAGE, folder, cut(0.5))),
    ("google", OBJ, None, (Path.unlink, text(b""))),
    ("google", f"{CAN}/google_16k", CAN, (shutil.rmtree,)),
    ("google", "can.urdf", None, (text(""), folder)),
    ("google", "can.urdf", "mass value is 0", (swap('"0.4"', '"0"'),)),
    ("maniskill", PLY, None, (Path.unlink, text(b""), GARBAGE)),
    ("maniskill", INFO, None, (text("[]"), pipe)),
    ("maniskill", INFO, "density is 0", (put(CAN, "density", value=0),)),
)
PICTURE = f"{CAN}/google_16k/material_0.png"
DRAWN = {
    "garbage": (OBJ, GARBAGE),
    "corner nan": (OBJ, swap("v 0.05", "v nan")),
    "no picture": (PICTURE, Path.unlink),
    "picture cut short": (PICTURE, cut(0.6)),
}


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """A dataset that is in order."""
    return whole_dataset(tmp_path_factory.mktemp("scenes") / "data")


def test_a_fault_in_a_ycb_folder_is_named(tmp_path, scenes):
    def check(case):
        kind, file, words, damage = case
        root = ycb_copy(tmp_path, kind)
        damage(root / file)
        words = words or Path(file).name
        refused_by_call(lambda: load_objects(root), words)
        refused_by_command(main, ["check", scenes, "--objects", root], words)

    cases = [(*case, damage) for *case, damages in IN_FOLDER for damage in damages]
    check_each({f"{number} {case}": case for number, case in enumerate(cases)}, check)


def test_what_cannot_be_drawn_is_named(tmp_path, scenes, monkeypatch):
    # Empty, as the copies that are drawn are found by the content of the OBJ alone.
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))

    def check(case):
        file, damage = case
        root = ycb_copy(tmp_path, "google")
        damage(root / file)
        refused_by_command(main, ["check", scenes, "--objects", root], "textured.obj")
        refused_by_call(lambda: textured_glb(root / OBJ), "textured.obj")

    check_each(DRAWN, check)


@pytest.mark.parametrize(("kind", "mass_kg"), [("google", 0.4), ("maniskill", 0.8)])
def test_a_ycb_folder_that_is_in_order_is_read(tmp_path, kind, mass_kg):
    objects = load_objects(ycb_copy(tmp_path, kind))
    # A box of 0.1 m: 1 litre at 800 kg/m3; the URDF states 0.4 kg.
    assert objects[CAN].mass_kg == pytest.approx(mass_kg)
    assert textured_glb(objects[CAN].visual_file).is_file()


def layouts_of(root: Path, out: Path, dataset: Path | None = None) -> None:
    """Writes a folder with one layout of a dataset."""
    made = {"name": "mine", "split": "val", "wild": False, "macros": {"mine_001": SCENE_ID}}
    templates = SceneDataset(root).templates
    write_layout_set(LayoutSet(dataset=str(dataset or root), templates=templates, **made), out)
    shutil.copy(root / SCENE, out / "mine_001.scene_instance.json")


LAYOUTS = {
    "format": (put("format", value=99), "format 99"),
    "dataset nowhere": (put("dataset", value="/nowhere"), "/nowhere"),
    "templates": (put("templates", value=1), "has changed"),
    "wild": (put("wild", value="no"), "wild: expected"),
    "macro unknown": (put("macros", value={"mine_001": "v3_sc0_staging_O0"}), SCENE_ID),
    "layout elsewhere": (put("macros", value={"../data/x": SCENE_ID}), "macros: expected"),
    "layout absent": (put("macros", value={"mine_002": SCENE_ID}), "mine_002"),
    "unknown field": (put("colour", value="red"), "colour"),
}


def test_a_fault_in_a_folder_of_layouts_is_named(tmp_path, scenes):
    def check(case):
        damage, words = case
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        layouts_of(scenes, folder)
        damage(folder / "layouts.json")
        refused_by_command(main, ["check", folder], words)
        refused_by_call(lambda: resolve_dataset(folder), words)

    check_each(LAYOUTS, check)
    layouts_of(scenes, tmp_path / "mine")
    assert load_scene(resolve_dataset(tmp_path / "mine"), "mine_001").objects
    layouts_of(scenes, tmp_path / "own", dataset=tmp_path / "own")  # layouts of layouts
    refused_by_call(lambda: resolve_dataset(tmp_path / "own"), "layouts.json", "layouts only")
