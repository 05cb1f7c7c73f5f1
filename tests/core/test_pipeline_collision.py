"""Convex parts of meshes, by each of the four methods."""

from pathlib import Path

import numpy as np
import pytest
import sapien
import trimesh
from textured import box_at

from hab_tasks.pipeline.collision import MAX_PARTS, write_parts
from hab_tasks.pipeline.options import AssetOptions
from hab_tasks.scenes.meshes import mesh_bounds, parts_volume


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """Every test computes for itself."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))


def export(path: Path, *meshes: trimesh.Trimesh) -> Path:
    scene = trimesh.Scene()
    for index, mesh in enumerate(meshes):
        scene.add_geometry(mesh, node_name=str(index), geom_name=str(index))
    scene.export(path, file_type="glb")
    return path


def corner_shape() -> trimesh.Trimesh:
    """An L of three unit cubes, as one surface: volume 3, its hull's 3.5."""
    outline = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    triangles = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    return trimesh.creation.extrude_triangulation(np.array(outline, float), triangles, 1.0)


def test_parts_of_a_visual_mesh(tmp_path):
    visual = export(tmp_path / "l.glb", corner_shape())
    for how, volume in (("hull", 3.5), ("merged-hull", 3.5), ("coacd", 3.0)):
        write_parts(None, visual, AssetOptions(collision=how), tmp_path / f"{how}.glb")
        assert parts_volume(tmp_path / f"{how}.glb") == pytest.approx(volume, rel=0.06), how
    assert len(trimesh.load_scene(tmp_path / "coacd.glb").dump()) >= 2


def test_hull_makes_one_part_of_each_piece(tmp_path):
    joined = trimesh.util.concatenate([box_at(0, 0, 0), box_at(3, 0, 0)])
    visual = export(tmp_path / "two.glb", joined)
    for how, volume in (("hull", 2.0), ("merged-hull", 4.0)):
        write_parts(None, visual, AssetOptions(collision=how), tmp_path / f"{how}.glb")
        assert parts_volume(tmp_path / f"{how}.glb") == pytest.approx(volume)


def test_the_datasets_own_parts_are_kept_unless_told_otherwise(tmp_path):
    visual = export(tmp_path / "l.glb", corner_shape())
    # The L's upright part, and half of the cube beside it.
    upright, half = box_at(0.5, 1, 0.5, size=(1, 2, 1)), box_at(1.5, 0.25, 0.5, size=(1, 0.5, 1))
    own = export(tmp_path / "own.glb", upright, half)
    write_parts(own, visual, AssetOptions(), tmp_path / "kept.glb")
    assert parts_volume(tmp_path / "kept.glb") == pytest.approx(2.5)
    write_parts(own, visual, AssetOptions(recompute=True), tmp_path / "new.glb")
    assert parts_volume(tmp_path / "new.glb") == pytest.approx(3.0, rel=0.06)


def test_a_collision_mesh_that_is_no_decomposition_is_not_taken_for_one(tmp_path):
    visual = export(tmp_path / "l.glb", corner_shape())
    for wrong, mesh in (("concave", corner_shape()), ("elsewhere", box_at(9, 0, 0))):
        own, parts = export(tmp_path / f"own_{wrong}.glb", mesh), tmp_path / f"{wrong}.glb"
        write_parts(own, visual, AssetOptions(), parts)
        assert parts_volume(parts) == pytest.approx(3.0, rel=0.06), wrong


def test_many_parts_become_few(tmp_path):
    cubes = [box_at(x, y, 0) for x in range(6) for y in range(6)]
    own = export(tmp_path / "own.glb", *cubes)
    write_parts(own, own, AssetOptions(), tmp_path / "parts.glb")
    assert len(trimesh.load_scene(tmp_path / "parts.glb").dump()) == MAX_PARTS
    assert parts_volume(tmp_path / "parts.glb") == pytest.approx(36.0)


def resting_height_m(parts: Path, radius_m: float) -> float | None:
    """Height over the table of a ball dropped into a bowl; None if it is not inside at the end."""
    (cx, cy, _), (hx, hy, hz) = mesh_bounds(parts)
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    builder = scene.create_actor_builder()
    builder.add_multiple_convex_collisions_from_file(str(parts))
    builder.build_static("bowl")
    builder = scene.create_actor_builder()
    builder.add_sphere_collision(radius=radius_m)
    # Off the middle, so that it rolls.
    top = mesh_bounds(parts)[0][2] + hz
    builder.initial_pose = sapien.Pose([cx + hx / 3, cy, top + 0.02])
    ball = builder.build("ball")
    scene.set_timestep(1 / 240)
    for _ in range(720):
        scene.step()
    x, y, z = ball.pose.p
    inside = np.hypot(x - cx, y - cy) < max(hx, hy) and z < top
    return float(z - (top - 2 * hz)) if inside else None


@pytest.mark.assets
def test_a_ball_stays_in_the_thinned_bowl(tmp_path, ycb):
    own = ycb / "024_bowl/google_16k/textured_vhacd.stl"
    visual = own.with_name("textured.obj")
    write_parts(own, visual, AssetOptions(collision="hull"), tmp_path / "before.glb")
    write_parts(own, visual, AssetOptions(), tmp_path / "after.glb")
    assert len(trimesh.load_scene(tmp_path / "before.glb").dump()) == 70
    assert len(trimesh.load_scene(tmp_path / "after.glb").dump()) == MAX_PARTS
    before, after = (resting_height_m(tmp_path / n, 0.015) for n in ("before.glb", "after.glb"))
    assert before is not None
    assert after is not None
    assert after == pytest.approx(before, abs=0.01)
    # The hollow is still there: the bowl's hull has 0.75 l.
    assert parts_volume(tmp_path / "after.glb") < 0.25e-3
