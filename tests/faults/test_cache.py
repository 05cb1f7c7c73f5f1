"""Damaged cache entries are rebuilt once; an unwritable cache is not used."""

import logging
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from builders import box_glb
from faulty_data import NAVMESH, cut, folder, pipe, read_as_env, text, whole_dataset
from refusals import check_each

from hab_tasks.io import cache
from hab_tasks.io.cache import cache_dir, cached
from hab_tasks.world.scenes import meshes


@pytest.fixture(autouse=True)
def fresh(tmp_path, monkeypatch):
    use(tmp_path / "cache", monkeypatch)


def use(folder, monkeypatch):
    """Uses a cache folder as a new process does: nothing is known or said yet."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(folder))
    monkeypatch.setattr(cache, "_said", set())
    monkeypatch.setenv(cache.RUN_DIR, "")  # so that a folder made meanwhile is forgotten
    monkeypatch.delenv(cache.RUN_DIR)
    forget()


def forget():
    for known in (meshes.check_mesh, meshes.check_any_mesh, meshes.parts_volume):
        known.cache_clear()
    meshes.mesh_bounds.cache_clear()
    meshes.content_key.cache_clear()


def walls(root):
    """Reads a layout whose inner walls come from navmeshes."""
    whole_dataset(root)
    (root / "navmeshes_default").mkdir()
    (root / NAVMESH).rename(root / NAVMESH.replace("navmeshes", "navmeshes_default"))
    return lambda: read_as_env(root).stage.collision


def parts(root):
    """Reads the convex parts of a mesh."""
    return lambda: meshes.parts_file(box_glb(root.with_suffix(".glb")))[1]


def test_a_damaged_entry_is_made_anew_with_one_warning(tmp_path, monkeypatch, caplog):
    def check(case):
        kind, damage = case
        here = Path(tempfile.mkdtemp(dir=tmp_path))
        use(here / "cache", monkeypatch)
        make = kind(here / "data")
        first = make()
        made = sorted(p for p in cache_dir().rglob("*") if not p.is_dir())
        assert made
        for entry in made:
            damage(entry)
        forget()
        caplog.clear()
        assert make() == first
        warnings = [line for line in caplog.messages if "damaged cache entry" in line]
        # Walls of a layout come from the walls of its stage, which are not looked at before.
        assert 1 <= len(warnings) <= len(made)
        assert all(any(str(entry) in line for entry in made) for line in warnings)
        assert all(len(line.splitlines()) == 1 for line in warnings)
        caplog.clear()
        forget()
        assert make() == first
        assert not caplog.records

    caplog.set_level(logging.WARNING)
    damages = {"cut": cut(0.6), "folder": folder, "pipe": pipe}
    cases = {name: (parts, damage) for name, damage in damages.items()}
    check_each(cases | {"walls": (walls, text(b"nothing of the kind" * 40))}, check)


def test_without_a_cache_the_result_is_the_same(tmp_path, monkeypatch, caplog):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("link")
    make = parts(tmp_path / "data")
    first = make()

    def check(chosen):
        use(chosen, monkeypatch)
        caplog.clear()
        assert [make(), make()] == [first, first]
        (warning,) = [text for text in caplog.messages if "HAB_CACHE_DIR" in text]
        assert str(chosen) in warning

    caplog.set_level(logging.WARNING)
    names = ("file", "file/cache", "link", "/proc/hab_tasks")
    check_each({name: tmp_path / name for name in names}, check)
    assert (tmp_path / "file").read_text() == "mine"


def test_a_full_disk_is_done_without(caplog):
    def full(path):
        if path.is_relative_to(cache_dir()):
            raise OSError(28, "No space left on device")
        path.write_text("7")

    caplog.set_level(logging.WARNING)
    assert cached("a", full, Path.read_text) == "7"
    assert cached("a", full, Path.read_text) == "7"
    (message,) = caplog.messages
    assert "No space left on device" in message
    assert [p for p in cache_dir().rglob("*") if not p.is_dir()] == []


@pytest.mark.slow
def test_an_environment_writes_nothing_of_ours_into_an_empty_home(tmp_path):
    env = {k: v for k, v in os.environ.items() if k not in ("HAB_CACHE_DIR", "XDG_CACHE_HOME")}
    env |= {"HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "tmp")}
    for name in ("home", "tmp"):
        (tmp_path / name).mkdir()
    code = 'import gymnasium as gym; gym.make("hab_tasks:HabPick-v1").reset(seed=0)'
    subprocess.run([sys.executable, "-c", code], env=env, check=True)
    assert not list((tmp_path / "home").rglob("*hab*"))
    assert not list((tmp_path / "tmp").glob("hab_tasks-*")), "the run's own folder is left"


KERNELS = """
from numba import njit
@njit(cache=True)
def one(x):
    return x + 1
@njit(cache=True)
def two(x):
    return x + 2
"""
LOADING = """
import logging, resource, sys
from hab_tasks.world.raycast.compiled import load
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
module = load("kernels.mine", lambda kernels: (kernels.one(1), kernels.two(1)))
print(module.one(2) + module.two(2))
"""


def test_kernels_are_compiled_in_memory_on_a_full_disk_and_again_if_damaged(tmp_path):
    (tmp_path / "kernels").mkdir()
    (tmp_path / "kernels/__init__.py").touch()
    (tmp_path / "kernels/mine.py").write_text(KERNELS)

    def warnings(most_bytes):
        env = {**os.environ, "PYTHONPATH": str(tmp_path)}
        command = [sys.executable, "-c", LOADING, str(most_bytes)]
        done = subprocess.run(command, env=env, capture_output=True, text=True)
        assert (done.returncode, done.stdout) == (0, "7\n"), done.stderr
        return done.stderr.splitlines()

    (full,) = warnings(100)
    assert "File too large" in full
    assert "kept for this run only" in full
    assert warnings(10**9) == []
    for file in cache_dir().rglob("mine.two*.nbi"):
        file.write_bytes(b"damaged")
    (damaged,) = warnings(10**9)
    assert "damaged cache entry" in damaged
    assert warnings(10**9) == []
