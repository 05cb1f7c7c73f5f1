"""Faults in a folder of YCB objects, in both layouts, and in a folder of layouts."""

import functools
import json
import math
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from faulty_data import (
    SCENE,
    SCENE_ID,
    Damage,
    cut,
    folder,
    loop,
    pipe,
    put,
    swap,
    text,
    whole_dataset,
)
from PIL import Image
from refusals import check_each, refused_by_call, refused_by_command

from hab_tasks.cli import main
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.scenes.habitat.layout_set import LayoutSet, write_layout_set
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.meshes import textured_glb
from hab_tasks.scenes.objects import load_objects

CAN = ALL_OBJECTS[0]
MASS_URDF = f"""<robot name="can"><link name="can">
<inertial><mass value="0.4"/></inertial>
<collision><geometry><mesh filename="{CAN}/google_16k/textured_vhacd.stl"/></geometry></collision>
</link></robot>"""


@functools.cache
def ycb_template(kind: str) -> Path:
    """A folder of 13 small textured boxes in the layout ``google`` or ``maniskill``."""
    root = Path(tempfile.mkdtemp(prefix="hab-faults-"))
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
    (root / "can.urdf").write_text(MASS_URDF)
    info = {name: {"density": 800} for name in ALL_OBJECTS}
    (root / "info_pick_v0.json").write_text(json.dumps(info))
    return root


def ycb_copy(tmp_path: Path, kind: str) -> Path:
    """A copy of such a folder that may be damaged."""
    return shutil.copytree(ycb_template(kind), Path(tempfile.mkdtemp(dir=tmp_path)) / kind)


GOOGLE, MANISKILL = f"{CAN}/google_16k", f"models/{CAN}"
STL, OBJ, PLY = (
    f"{GOOGLE}/textured_vhacd.stl",
    f"{GOOGLE}/textured.obj",
    f"{MANISKILL}/collision.ply",
)
INFO, CAN_URDF = "info_pick_v0.json", "can.urdf"
GARBAGE = text(b"nothing of the kind\n" * 20)
MESH_FAULTS = {"empty": text(b""), "garbage": GARBAGE, "folder": folder, "pipe": pipe, "loop": loop}


def nan_stl(file: Path) -> None:
    """Puts a NaN into the first corner of a binary STL."""
    data = bytearray(file.read_bytes())
    data[96:100] = np.float32(math.nan).tobytes()
    file.write_bytes(data)


def density(value: object) -> Damage:
    """Changes the density of an object."""
    return put(CAN, "density", value=value)


CASES: dict[str, tuple[str, str, Damage, str]] = {
    **{f"stl {k}": ("google", STL, d, "textured_vhacd.stl") for k, d in MESH_FAULTS.items()},
    "stl cut": ("google", STL, cut(0.5), "textured_vhacd.stl"),
    "stl nan": ("google", STL, nan_stl, "textured_vhacd.stl"),
    **{f"ply {k}": ("maniskill", PLY, d, "collision.ply") for k, d in MESH_FAULTS.items()},
    "ply absent": ("maniskill", PLY, Path.unlink, "collision.ply"),
    "obj absent": ("google", OBJ, Path.unlink, "textured.obj"),
    "obj empty": ("google", OBJ, text(b""), "textured.obj"),
    "obj pipe": ("google", OBJ, pipe, "textured.obj"),
    "no objects": ("google", GOOGLE, shutil.rmtree, CAN),
    "info empty": ("maniskill", INFO, text(""), INFO),
    "info list": ("maniskill", INFO, text("[]"), INFO),
    "info cut": ("maniskill", INFO, cut(0.5), INFO),
    "info pipe": ("maniskill", INFO, pipe, INFO),
    "about number": ("maniskill", INFO, put(CAN, value=5), f"{CAN} is 5"),
    "density text": ("maniskill", INFO, density("heavy"), f"{CAN}.density is 'heavy'"),
    "density zero": ("maniskill", INFO, density(0), "density is 0"),
    "urdf empty": ("google", CAN_URDF, text(""), CAN_URDF),
    "urdf folder": ("google", CAN_URDF, folder, CAN_URDF),
    "mass text": ("google", CAN_URDF, swap('"0.4"', '"heavy"'), "mass value is 'heavy'"),
    "mass zero": ("google", CAN_URDF, swap('"0.4"', '"0"'), "mass value is 0"),
    "mass absent": ("google", CAN_URDF, swap(' value="0.4"', ""), "mass value is None"),
}


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """A dataset that is in order."""
    return whole_dataset(tmp_path_factory.mktemp("scenes") / "data")


def test_a_fault_in_a_ycb_folder_is_named(tmp_path, scenes):
    def check(name):
        kind, file, damage, words = CASES[name]
        root = ycb_copy(tmp_path, kind)
        damage(root / file)
        refused_by_call(lambda: load_objects(root), words)
        if name in ("stl garbage", "info list", "density zero", "mass zero"):
            refused_by_command(main, ["check", scenes, "--objects", root], words)

    check_each({name: name for name in CASES}, check)


VISUALS: dict[str, tuple[str, Damage]] = {
    "obj garbage": ("textured.obj", GARBAGE),
    "obj nan": ("textured.obj", swap("v 0.05", "v nan")),
    "no material": ("material.mtl", Path.unlink),
    "no picture": ("material_0.png", Path.unlink),
    "picture garbage": ("material_0.png", GARBAGE),
    "picture cut": ("material_0.png", cut(0.6)),
}


def test_what_cannot_be_drawn_is_named(tmp_path, scenes, monkeypatch):
    # Empty, as the copies that are drawn are found by the content of the OBJ alone.
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))

    def check(case):
        name, damage = case
        root = ycb_copy(tmp_path, "google")
        damage(root / GOOGLE / name)
        refused_by_command(main, ["check", scenes, "--objects", root], "textured.obj")
        refused_by_call(lambda: textured_glb(root / OBJ), "textured.obj")

    check_each(VISUALS, check)


@pytest.mark.parametrize("kind", ["google", "maniskill"])
def test_a_ycb_folder_that_is_in_order_is_read(tmp_path, kind):
    objects = load_objects(ycb_copy(tmp_path, kind))
    # A box of 0.1 m: 1 litre at 800 kg/m3; the URDF states 0.4 kg.
    assert objects[CAN].mass_kg == pytest.approx(0.4 if kind == "google" else 0.8)
    assert textured_glb(objects[CAN].visual_file).is_file()


# Folders of layouts ------------------------------------------------------------------------------


def layouts_of(root: Path, out: Path) -> LayoutSet:
    """Writes a folder with one layout of a dataset."""
    layouts = LayoutSet(
        name="mine",
        dataset=str(root),
        templates=SceneDataset(root).templates,
        split="val",
        wild=False,
        macros={"mine_001": SCENE_ID},
    )
    write_layout_set(layouts, out)
    shutil.copy(root / SCENE, out / "mine_001.scene_instance.json")
    return layouts


LAYOUTS: dict[str, tuple[Damage, str]] = {
    "empty": (text(""), "not valid JSON"),
    "cut": (cut(0.5), "not valid JSON"),
    "pipe": (pipe, "a pipe"),
    "other format": (put("format", value=99), "format 99"),
    "dataset nowhere": (put("dataset", value="/nowhere"), "/nowhere"),
    "dataset nul": (put("dataset", value="a\0b"), "layouts.json"),
    "templates other": (put("templates", value=1), "has changed"),
    "split unknown": (put("split", value="vall"), "'vall'"),
    "wild text": (put("wild", value="no"), "damaged (wild)"),
    "macros empty": (put("macros", value={}), "no layouts"),
    "macro number": (put("macros", value={"mine_001": 3}), "damaged (macros)"),
    "macro unknown": (put("macros", value={"mine_001": "v3_sc0_staging_O0"}), SCENE_ID),
    "layout elsewhere": (put("macros", value={"../data/x": SCENE_ID}), "damaged (macros)"),
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


def test_layouts_of_layouts_end_at_once(tmp_path, scenes):
    layouts = layouts_of(scenes, tmp_path / "mine")
    write_layout_set(replace(layouts, dataset=str(tmp_path / "mine")), tmp_path / "mine")
    refused_by_call(lambda: resolve_dataset(tmp_path / "mine"), "layouts.json", "layouts only")


def test_a_folder_of_layouts_that_is_in_order_is_read(tmp_path, scenes):
    layouts_of(scenes, tmp_path / "mine")
    assert load_scene(resolve_dataset(tmp_path / "mine"), "mine_001").objects
