"""Damaged cache entries are rebuilt once; an unwritable cache is not used."""

import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh
from builders import box_glb
from faulty_data import NAVMESH, Damage, cut, folder, loop, pipe, read_as_env, text, whole_dataset
from refusals import check_each
from textured import textured_dataset

from hab_tasks import cache
from hab_tasks.cache import cache_dir, cached, read_cached, write_cached
from hab_tasks.errors import DatasetError, EpisodeError
from hab_tasks.pipeline.optimise import optimise
from hab_tasks.pipeline.options import AssetOptions
from hab_tasks.robots.light_visuals import light_mesh
from hab_tasks.scenes.habitat.dataset import SceneDataset
from hab_tasks.scenes.mesh_checks import check_mesh
from hab_tasks.scenes.meshes import (
    check_any_mesh,
    content_key,
    mesh_bounds,
    parts_file,
    parts_volume,
)

DAMAGE: dict[str, Damage] = {
    "empty": text(b""),
    "cut": cut(0.6),
    "garbage": text(b"nothing of the kind" * 40),
    "folder": folder,
    "pipe": pipe,
    "loop": loop,
}


@pytest.fixture(autouse=True)
def fresh(tmp_path, monkeypatch):
    """An empty cache, and nothing said yet."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_said", set())
    monkeypatch.setattr(cache, "_run_dir", None)


def walls(tmp_path: Path) -> Callable[[], object]:
    """Reads a layout whose inner walls come from navmeshes."""
    root = tmp_path / "data"
    if not root.exists():
        whole_dataset(root)
        (root / "navmeshes_default").mkdir()
        (root / NAVMESH).rename(root / NAVMESH.replace("navmeshes", "navmeshes_default"))
    return lambda: read_as_env(root).stage.collision


def parts(tmp_path: Path) -> Callable[[], object]:
    """Reads the convex parts of a mesh."""
    return lambda: parts_file(box_glb(tmp_path / "box.glb"))[1]


def light(tmp_path: Path) -> Callable[[], object]:
    """Makes a light copy of one of the robot's meshes."""
    file = box_glb(tmp_path / "arm.glb")
    return lambda: trimesh.load_scene(light_mesh(file, "1 0 0 1")).bounds.tolist()


def copied(tmp_path: Path) -> Callable[[], object]:
    """Makes an optimised copy of a dataset; returns how long its files are."""
    if not (tmp_path / "textured").exists():
        textured_dataset(tmp_path / "textured")
    options = AssetOptions(collision="hull", texture_format="png", texture_px=64)

    def make() -> object:
        out = tmp_path / "out"
        optimise(SceneDataset(tmp_path / "textured"), out, options, force=True)
        return sorted((f.name, f.stat().st_size) for f in out.rglob("*") if f.is_file())

    return make


KINDS = {"walls": walls, "parts": parts, "light": light, "assets": copied}


def forget() -> None:
    """Forgets which files are in order, as a new process does."""
    for known in (check_mesh, check_any_mesh, parts_volume, mesh_bounds, content_key):
        known.cache_clear()


def entries() -> list[Path]:
    """The files in the cache."""
    return sorted(p for p in cache_dir().rglob("*") if not p.is_dir())


def check_made_anew(make, first, damage: Damage, caplog) -> None:
    """Damages all entries; asserts that they are made anew, with a warning, and only once."""
    made = entries()
    assert made
    for entry in made:
        damage(entry)
    forget()
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        assert make() == first
    warnings = [r.getMessage() for r in caplog.records if "damaged cache entry" in r.getMessage()]
    # Walls of a layout come from the walls of its stage, which are not looked at before.
    assert 1 <= len(warnings) <= len(made)
    assert all(any(str(entry) in line for entry in made) for line in warnings)
    assert all(len(line.splitlines()) == 1 for line in warnings)
    caplog.clear()
    forget()
    assert make() == first
    assert not caplog.records


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_entry_is_made_anew_with_one_warning(tmp_path, caplog, kind):
    make = KINDS[kind](tmp_path)
    first = make()

    def check(damage):
        cache._said.clear()
        check_made_anew(make, first, damage, caplog)

    check_each(DAMAGE if kind == "parts" else {"cut": DAMAGE["cut"]}, check)


def number(path: Path) -> int:
    return json.loads(path.read_text())["number"]


def write_number(path: Path) -> None:
    path.write_text('{"number": 7}')


def test_whatever_reading_raises_the_entry_counts_as_absent():
    def check(error):
        write_cached("a/b.json", write_number)

        def read(path: Path) -> int:
            raise error

        assert read_cached("a/b.json", read) is None
        assert cached("a/b.json", write_number, number) == 7

    errors = (EpisodeError("x: bad"), DatasetError("y"), OSError(5, "I/O"), KeyError("a"))
    check_each({repr(error): error for error in errors}, check)


def test_an_absent_entry_is_no_news(caplog):
    assert read_cached("a/b.json", number) is None
    assert not caplog.records


# A cache that cannot be written to ----------------------------------------------------------------


def unwritable(tmp_path: Path) -> dict[str, Path]:
    """Places in which nothing can be written."""
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("link")
    return {
        "a file": tmp_path / "file",
        "below a file": tmp_path / "file" / "cache",
        "a link to itself": tmp_path / "link",
        "of the kernel": Path("/proc/hab_tasks"),
        "a long name": tmp_path / ("a" * 300),
    }


@pytest.mark.parametrize("kind", ["parts", "assets"])
def test_without_a_cache_the_result_is_the_same(tmp_path, monkeypatch, caplog, kind):
    make = KINDS[kind](tmp_path)
    first = make()

    def check(chosen):
        monkeypatch.setenv("HAB_CACHE_DIR", str(chosen))
        monkeypatch.setattr(cache, "_run_dir", None)
        cache._said.clear()
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            assert make() == first
            assert make() == first
        (warning,) = [r.getMessage() for r in caplog.records if "HAB_CACHE" in r.getMessage()]
        assert str(chosen) in warning
        assert "HAB_CACHE_DIR" in warning

    places = unwritable(tmp_path)
    check_each(places if kind == "parts" else {"a file": places["a file"]}, check)
    assert places["a file"].read_text() == "mine"


def test_a_full_disk_is_done_without(monkeypatch, caplog):
    def full(path: Path) -> None:
        if path.is_relative_to(cache_dir()):
            raise OSError(28, "No space left on device")
        write_number(path)

    with caplog.at_level(logging.WARNING):
        assert cached("a.json", full, number) == 7
        assert cached("a.json", full, number) == 7
    (record,) = caplog.records
    assert "No space left on device" in record.getMessage()
    assert entries() == []


def test_a_fault_of_the_data_is_no_fault_of_the_cache(caplog):
    def fail(path: Path) -> None:
        raise DatasetError("table.glb: damaged") from OSError(5, "I/O error")

    with pytest.raises(DatasetError, match=r"table\.glb"):
        cached("a.json", fail, number)
    assert not caplog.records


def test_without_a_name_the_cache_is_in_the_home_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HAB_CACHE_DIR", "")
    assert cache_dir() == tmp_path / ".cache/hab_tasks"
    monkeypatch.delenv("HAB_CACHE_DIR")
    assert cache_dir() == tmp_path / ".cache/hab_tasks"
    assert not cache_dir().exists(), "asking where it is must not make it"


ALONE = """
import gymnasium as gym
env = gym.make("hab_tasks:HabPick-v1")
env.reset(seed=0)
"""


@pytest.mark.slow
def test_an_environment_writes_nothing_of_ours_into_an_empty_home(tmp_path):
    env = {k: v for k, v in os.environ.items() if k not in ("HAB_CACHE_DIR", "XDG_CACHE_HOME")}
    env |= {"HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "tmp")}
    for name in ("home", "tmp"):
        (tmp_path / name).mkdir()
    done = subprocess.run([sys.executable, "-c", ALONE], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert not list((tmp_path / "home").rglob("*hab*"))
    assert not list((tmp_path / "tmp").glob("hab_tasks-*")), "the run's own folder is left"
