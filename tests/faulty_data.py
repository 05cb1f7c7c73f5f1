"""A small dataset with one file of each kind, ways to damage it, and the readers to refuse it."""

import atexit
import functools
import json
import os
import shutil
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from builders import table_config, tiny_dataset, tiny_scene, write_json, write_scene
from refusals import refused_by_call, refused_by_command

from hab_tasks.cli import main
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene

SCENE_ID = "v3_sc0_staging_00"
SCENE = f"configs/scenes/{SCENE_ID}.scene_instance.json"
TABLE = "configs/objects/table.object_config.json"
CUBE = "configs/objects/cube.object_config.json"
STAGE = "configs/stages/room.stage_config.json"
LIGHTS = "configs/lighting/sun.lighting_config.json"
LEXICON = "configs/ssd/tiny_semantic_lexicon.json"
CONFIG = "tiny.scene_dataset_config.json"
URDF = "urdf/chests/chest.urdf"
AO = "urdf/chests/chest.ao_config.json"
NAVMESH = f"navmeshes/{SCENE_ID}.navmesh"
RECEPTACLE = "receptacle_aabb_Tbl1_Top1_frl_apartment_table_01"

GONE = object()
"""A value that is taken out."""

Keys = tuple[str | int, ...]
Damage = Callable[[Path], object]
"""Damages a file."""


def whole_dataset(root: Path) -> Path:
    """Copies a dataset that is in order; every file of it is read by its one layout."""
    shutil.copytree(_template(), root)
    return root


def kept_folder() -> Path:
    """A folder that is removed when this process ends."""
    folder = tempfile.mkdtemp(prefix="hab-faults-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@functools.cache
def _template() -> Path:
    root = tiny_dataset(kept_folder() / "tiny")
    write_json(root / TABLE, table_config() | {"semantic_id": 3})
    lamp = {"position": [1, 2, 3], "intensity": 2.0, "color": [1, 0.5, 0]}
    write_json(root / LIGHTS, {"lights": {"a": lamp}})
    write_json(root / LEXICON, {"classes": [{"id": 3, "name": "table"}]})
    inside = {"parent_link": "drawer", "position": [0.1, 0, 0.2], "scale": [0.1, -0.05, 0.2]}
    write_json(root / AO, {"user_defined": {"receptacle_aabb_in": inside}})
    (root / "navmeshes").mkdir()
    (root / NAVMESH).write_bytes(navmesh_bytes([(0, 0, 2, 2, 0.1, 0.1), (2, 0, 3, 2, 0.1, 0.1)]))
    write_scene(root, tiny_scene() | {"default_lighting": "lighting/sun"})
    return root


def refused_everywhere(root: Path, *words: str) -> None:
    """Asserts that `hab-tasks check` and the environments' reader refuse a dataset."""
    refused_by_command(main, ["check", root], *words)
    refused_by_call(lambda: read_as_env(root), *words)


def refused_with(tmp_path: Path, name: str, damage: Damage, *words: str) -> None:
    """Asserts that a new copy of the whole dataset with a damaged file is refused."""
    root = whole_dataset(Path(tempfile.mkdtemp(dir=tmp_path)) / "data")
    damage(root / name)
    refused_everywhere(root, *words)


def read_as_env(root: Path) -> object:
    """Reads a dataset as an environment does before it builds anything."""
    dataset = SceneDataset(root)
    _ = dataset.fingerprint
    return load_scene(dataset, SCENE_ID)


# Damage -----------------------------------------------------------------------------------------


def put(*keys: str | int, value: object) -> Damage:
    """Replaces one value of a JSON file, or takes it out (`GONE`)."""

    def damage(file: Path) -> None:
        data = json.loads(file.read_text())
        holder = data
        for key in keys[:-1]:
            holder = holder[key]
        if value is GONE:
            del holder[keys[-1]]
        else:
            holder[keys[-1]] = value
        file.write_text(json.dumps(data))

    return damage


def text(content: str | bytes) -> Damage:
    """Replaces a file's content."""
    return lambda file: file.write_bytes(content.encode() if isinstance(content, str) else content)


def swap(old: str, new: str) -> Damage:
    """Replaces a part of a text file that has to be there."""

    def damage(file: Path) -> None:
        before = file.read_text()
        assert old in before, old
        file.write_text(before.replace(old, new, 1))

    return damage


def cut(share: float) -> Damage:
    """Keeps only the first part of a file."""

    def damage(file: Path) -> None:
        data = file.read_bytes()
        file.write_bytes(data[: int(share * len(data))])

    return damage


def folder(file: Path) -> None:
    """Puts a folder in a file's place."""
    file.unlink()
    file.mkdir()


def pipe(file: Path) -> None:
    """Puts a pipe in a file's place: whoever opens it waits for ever."""
    file.unlink()
    os.mkfifo(file)


def loop(file: Path) -> None:
    """Puts a link to itself in a file's place."""
    file.unlink()
    file.symlink_to(file.name)


def rewrite_glb(change: Callable[[dict, bytearray], object]) -> Damage:
    """Changes the document and the buffer of a GLB; its lengths stay consistent."""

    def damage(file: Path) -> None:
        data = file.read_bytes()
        length = struct.unpack_from("<I", data, 12)[0]
        document, body = json.loads(data[20 : 20 + length]), bytearray(data[28 + length :])
        change(document, body)
        file.write_bytes(glb_bytes(json.dumps(document).encode(), bytes(body)))

    return damage


def glb_bytes(document: bytes, body: bytes) -> bytes:
    """A GLB file with consistent lengths."""
    document += b" " * (-len(document) % 4)
    chunks = struct.pack("<I4s", len(document), b"JSON") + document
    chunks += struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def navmesh_bytes(rectangles, low=(0.0, -0.05, 0.0), high=(6.0, 2.0, 4.0), joined=()) -> bytes:
    """A file as Habitat writes it: one tile; rectangles (x0, z0, x1, z1, y at x0, y at x1).

    `joined` holds pairs of polygons that are neighbours.
    """
    corners, polygons, details, triangles = [], b"", b"", b""
    for index, (x0, z0, x1, z1, y0, y1) in enumerate(rectangles):
        corners += [(x0, y0, z0), (x1, y1, z0), (x1, y1, z1), (x0, y0, z1)]
        others = [b for a, b in joined if a == index] + [a for a, b in joined if b == index]
        neighbours = [other + 1 for other in others] + [0] * (6 - len(others))
        own = [4 * index + k for k in range(4)] + [0, 0]
        polygons += struct.pack("<I6H6HHBB", 0, *own, *neighbours, 1, 4, 0)
        details += struct.pack("<IIBBH", 0, 2 * index, 0, 2, 0)
        triangles += bytes((0, 1, 2, 0, 0, 2, 3, 0))
    count = len(rectangles)
    counts = (count, 4 * count, 0, count, 0, 2 * count)
    header = struct.pack("<4s14i", b"VAND", 7, 0, 0, 0, 0, *counts, 0, 0, count)
    header += struct.pack("<3f6ff", 1.5, 0.1, 0.2, *low, *high, 20.0)
    settings = struct.pack("<13f", 0.05, 0.2, 1.5, 0.1, 0.2, 45, 20, 20, 12, 1.3, 6, 6, 1)
    start = b"TESM" + struct.pack("<ii", 2, 1) + b"\0" * 28 + settings + b"\0" * 12
    points = np.array(corners, dtype="<f4").tobytes()
    return start + header + points + polygons + details + triangles
