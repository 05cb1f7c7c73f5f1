"""Unreadable mesh files, which would give bodies without collision or visual shapes."""

import math
import shutil
import struct
import tempfile
from pathlib import Path

import pytest
from builders import box_glb, cpu_scene, write_json
from faulty_data import (
    NAVMESH,
    STAGE,
    TABLE,
    URDF,
    Damage,
    cut,
    folder,
    glb_bytes,
    navmesh_bytes,
    pipe,
    put,
    read_as_env,
    refused_everywhere,
    rewrite_glb,
    swap,
    text,
    whole_dataset,
)
from refusals import check_each, refused_by_call, refused_by_command

from hab_tasks.cli import main
from hab_tasks.world.scenes.pool import BodyPool


def entry(kind, number, **values) -> Damage:
    """Changes an entry of one of a GLB's lists."""
    return rewrite_glb(lambda document, body: document[kind][number].update(values))


def corner(value: float) -> Damage:
    """Changes the first coordinate of a box's first corner."""

    def change(document, body):
        primitive = document["meshes"][0]["primitives"][0]
        accessor = document["accessors"][primitive["attributes"]["POSITION"]]
        view = document["bufferViews"][accessor["bufferView"]]
        struct.pack_into("<f", body, view.get("byteOffset", 0), value)

    return rewrite_glb(change)


def written(at: int, kind: str, value: float) -> Damage:
    """Writes a value into a binary file."""

    def damage(file) -> None:
        data = bytearray(file.read_bytes())
        struct.pack_into(f"<{kind}", data, at, value)
        file.write_bytes(data)

    return damage


def shortened(file) -> None:
    """Cuts a GLB short, with a header that says so."""
    data = file.read_bytes()[:-200]
    file.write_bytes(data[:8] + struct.pack("<I", len(data)) + data[12:])


GLB: dict[str, Damage] = {
    "empty": text(b""),
    "shortened": shortened,
    "version 1": written(4, "I", 1),
    "garbage": text(glb_bytes(bytes(range(32, 128)), bytes(64))),
    "no mesh": text(glb_bytes(b'{"asset":{"version":"2.0"}}', bytes(64))),
    "no corners": entry("meshes", 0, primitives=[{"attributes": {}}]),
    "count too large": entry("accessors", 1, count=10**6),
    "unknown kind": entry("accessors", 1, componentType=1),
    "unknown view": entry("accessors", 1, bufferView=77),
    "view too long": entry("bufferViews", 1, byteLength=10**6),
    "index too large": rewrite_glb(lambda d, body: body.__setitem__(slice(0, 4), b"\xff" * 4)),
    "odd indices": entry("accessors", 0, count=35),
    "corner nan": corner(math.nan),
    "node nan": entry("nodes", 0, matrix=16 * [math.nan]),
    "node cycle": entry("nodes", 0, children=[0]),
    "node of no mesh": entry("nodes", 0, mesh=4),
    "folder": folder,
    "pipe": pipe,
}
IN_EVERY_ROLE = ("corner nan", "folder")

ROLES = {
    "collision": "objects/convex.glb",
    "visual": "objects/table.glb",
    "box": "objects/cube.glb",
    "furniture": "urdf/chests/body.glb",
    "stage": "stages/room.glb",
    "stage collision": "stages/convex.glb",
}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The whole dataset with convex parts in files of their own, and a mesh for the stage."""
    root = whole_dataset(tmp_path_factory.mktemp("meshes") / "data")
    for name in ("objects/convex.glb", "stages/room.glb", "stages/convex.glb"):
        box_glb(root / name, (1.0, 0.8, 0.6))
    put("collision_asset", value="../../objects/convex.glb")(root / TABLE)
    put("collision_asset", value="../../stages/convex.glb")(root / STAGE)
    return root


def copied(data, tmp_path):
    """A copy of a dataset that may be damaged."""
    return shutil.copytree(data, Path(tempfile.mkdtemp(dir=tmp_path)) / "data")


def test_a_mesh_that_cannot_be_read_is_named(data, tmp_path):
    def check(case):
        role, damage = case
        root = copied(data, tmp_path)
        GLB[damage](root / ROLES[role])
        refused_everywhere(root, Path(ROLES[role]).stem)

    cases = {damage: ("collision", damage) for damage in GLB}
    cases |= {f"{role}, {damage}": (role, damage) for role in ROLES for damage in IN_EVERY_ROLE}
    check_each(cases, check)


def test_a_damaged_mesh_that_no_layout_uses_is_found_by_check(data, tmp_path):
    root = copied(data, tmp_path)
    box_glb(root / "objects/spare.glb")
    config = {"render_asset": "../../objects/spare.glb", "use_bounding_box_for_collision": True}
    write_json(root / "configs/objects/spare.object_config.json", config)
    GLB["corner nan"](root / "objects/spare.glb")
    refused_by_command(main, ["check", root], "spare.glb", "not finite")
    read_as_env(root)


def compressed(document, body) -> None:
    """Says that the mesh is compressed, as the engine cannot read it."""
    for accessor in document["accessors"]:
        accessor.pop("bufferView", None)
    name = "KHR_draco_mesh_compression"
    document |= {"extensionsUsed": [name], "extensionsRequired": [name]}
    extension = {name: {"bufferView": 0, "attributes": {"POSITION": 0}}}
    document["meshes"][0]["primitives"][0]["extensions"] = extension


def test_what_the_engine_makes_no_shape_of_is_refused_when_it_is_built(data, tmp_path):
    def check(case):
        name, word = case
        root = copied(data, tmp_path)
        swap('<box size="0.4 0.3, 0.2"/>', '<mesh filename="body.glb"/>')(root / URDF)
        rewrite_glb(compressed)(root / name)
        refused_by_call(lambda: BodyPool(cpu_scene(), {}).show(read_as_env(root), ()), word)
        refused_by_command(main, ["check", root], word)

    words = {"collision": "convex.glb", "furniture": "chest.urdf"}
    check_each({role: (ROLES[role], word) for role, word in words.items()}, check)


def test_garbage_in_other_formats_is_named(data, tmp_path):
    def check(key):
        root = copied(data, tmp_path)
        (root / "objects/other.obj").write_bytes(b"nothing of the kind\n" * 9)
        put(key, value="../../objects/other.obj")(root / TABLE)
        refused_everywhere(root, "other.obj")

    check_each({key: key for key in ("render_asset", "collision_asset")}, check)


TILE_AT = navmesh_bytes([(0, 0, 2, 2, 0.1, 0.1)]).find(b"VAND")
CORNERS_AT = TILE_AT + 100
POLYGONS_AT = CORNERS_AT + 8 * 12

NAVMESHES: dict[str, Damage] = {
    "no tile": text(b"nothing of the kind" * 20),
    "cut header": cut(0.3),
    "two tiles": lambda file: file.write_bytes(2 * file.read_bytes()),
    "version": written(4, "i", 9),
    "cell zero": written(40, "f", 0.0),
    "radius negative": written(TILE_AT + 64, "f", -1.0),
    "bounds nan": written(TILE_AT + 72, "f", math.nan),
    "no polygons": written(TILE_AT + 24, "i", 0),
    "corner nan": written(CORNERS_AT, "f", math.nan),
    "corner unknown": written(POLYGONS_AT + 4, "H", 999),
    "polygon of 9": written(POLYGONS_AT + 30, "B", 9),
}


def test_a_damaged_navmesh_is_named(tmp_path):
    def check(damage):
        root = whole_dataset(Path(tempfile.mkdtemp(dir=tmp_path)) / "data")
        damage(root / NAVMESH)
        refused_by_command(main, ["check", root], NAVMESH)
        if damage is NAVMESHES["bounds nan"]:
            # A stage without a mesh needs no more than bounds that make sense.
            refused_by_call(lambda: read_as_env(root), NAVMESH)

    check_each(NAVMESHES, check)
