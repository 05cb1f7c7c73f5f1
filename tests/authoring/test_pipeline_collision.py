"""Convex parts of meshes, by each of the four methods."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hab_authoring.pipeline.collision import MAX_PARTS, write_parts
from hab_authoring.pipeline.jobs import AssetOptions
from textured import box_at

from hab_tasks.world.scenes.meshes import parts_volume


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """Every test computes for itself."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))


def export(path: Path, *meshes: trimesh.Trimesh) -> Path:
    trimesh.Scene(list(meshes)).export(path, file_type="glb")
    return path


def test_volumes_of_parts(tmp_path):
    # An L of three unit cubes, as one surface: volume 3, its hull's 3.5.
    outline = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], float)
    triangles = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    solid = trimesh.creation.extrude_triangulation(outline, triangles, 1.0)
    corner = export(tmp_path / "l.glb", solid)
    cubes = trimesh.util.concatenate([box_at(0, 0, 0), box_at(3, 0, 0)])
    pair = export(tmp_path / "pair.glb", cubes)
    # The L's upright part, and half of the cube beside it; a box that is not where the L is.
    upright, half = box_at(0.5, 1, 0.5, size=(1, 2, 1)), box_at(1.5, 0.25, 0.5, size=(1, 0.5, 1))
    own = export(tmp_path / "own.glb", upright, half)
    elsewhere = export(tmp_path / "elsewhere.glb", box_at(9, 0, 0))
    grid = [box_at(x, y, 0) for x in range(6) for y in range(6)]
    many = export(tmp_path / "many.glb", *grid)
    cases = (
        (None, corner, {"collision": "hull"}, 1, 3.5, 1e-6),
        (None, corner, {"collision": "merged-hull"}, 1, 3.5, 1e-6),
        (None, corner, {}, 2, 3.0, 0.06),
        (None, pair, {"collision": "hull"}, 2, 2.0, 1e-6),
        (None, pair, {"collision": "merged-hull"}, 1, 4.0, 1e-6),
        (own, corner, {}, 2, 2.5, 1e-6),
        (own, corner, {"recompute": True}, 2, 3.0, 0.06),
        # Neither a concave mesh nor one elsewhere is taken for a decomposition.
        (corner, corner, {}, 2, 3.0, 0.06),
        (elsewhere, corner, {}, 2, 3.0, 0.06),
        (many, many, {}, MAX_PARTS, 36.0, 1e-6),
    )
    for number, (given, visual, options, count, volume, rel) in enumerate(cases):
        parts = tmp_path / f"{number}.glb"
        write_parts(given, visual, AssetOptions(**options), parts)
        assert parts_volume(parts) == pytest.approx(volume, rel=rel), number
        assert len(trimesh.load_scene(parts).dump()) == count, number


@pytest.mark.assets
def test_a_thinned_bowl_is_still_hollow(tmp_path, ycb):
    own = ycb / "024_bowl/google_16k/textured_vhacd.stl"
    for how, count in (("hull", 70), ("coacd", MAX_PARTS)):
        parts = tmp_path / f"{how}.glb"
        options = AssetOptions(collision=how)
        write_parts(own, own.with_name("textured.obj"), options, parts)
        assert len(trimesh.load_scene(parts).dump()) == count
        # The bowl's hull has 0.75 l.
        assert parts_volume(parts) < 0.25e-3, how
