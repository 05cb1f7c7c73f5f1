"""Light visual meshes: shape, texture and materials are kept; memory shrinks."""

from itertools import pairwise

import numpy as np
import pytest
import sapien
import trimesh
from hab_authoring.pipeline.decimate import FEWEST_TRIANGLES, thin
from hab_authoring.pipeline.glb import read_glb
from hab_authoring.pipeline.jobs import AssetOptions
from hab_authoring.pipeline.optimise import INDEX_BYTES, VERTEX_BYTES, footprint
from hab_authoring.pipeline.visuals import write_light_glb
from PIL import Image
from textured import sphere, textured_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from hab_tasks.errors import DatasetError


def test_a_sphere_keeps_a_quarter_of_its_triangles_its_shape_and_its_charts():
    surface, half = sphere()
    assert len(surface.faces) == 20 * 4**4  # an icosahedron, each triangle split in four, 4 times
    thinned = thin(surface, 0.25)
    assert len(thinned.faces) == pytest.approx(1280, abs=4)
    light = trimesh.Trimesh(surface.points, thinned.position, process=False)
    on_light = trimesh.sample.sample_surface(light, 500, seed=0)[0]
    assert np.abs(np.linalg.norm(on_light, axis=1) - 1.0).max() < 0.02
    # Watertight once welded: no crack between the halves.
    light.merge_vertices()
    assert light.is_watertight
    own = half[surface.faces[thinned.faces, 0]]
    assert (half[thinned.attribute] == own[:, None]).all(), "a triangle reaches into another chart"
    # The texture moves no farther than the allowed share of the diagonal, 2 * sqrt(3).
    gap = surface.points[thinned.position] - surface.points[thinned.attribute]
    assert np.linalg.norm(gap, axis=2).max() <= 0.02 * 2 * np.sqrt(3)


def test_a_mesh_of_few_triangles_keeps_them():
    surface, _ = sphere(2)
    assert len(surface.faces) < FEWEST_TRIANGLES
    assert np.array_equal(thin(surface, 0.1).position, surface.faces)


def test_a_light_glb_keeps_nodes_and_materials(tmp_path):
    turned = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [1, 0, 0])
    source = textured_glb(tmp_path / "a.glb", transform=turned)
    write_light_glb(source, AssetOptions(decimate=0.25, texture_px=32), tmp_path / "b.glb")
    before, after = (trimesh.load_scene(tmp_path / name) for name in ("a.glb", "b.glb"))
    assert np.allclose(before.bounds, after.bounds, atol=0.03)
    assert np.allclose(before.graph.get("ball")[0], after.graph.get("ball")[0])
    box, ball = sorted(after.dump(), key=lambda mesh: len(mesh.faces))
    assert len(box.faces) == 12
    assert len(ball.faces) == pytest.approx(1280, abs=4)
    assert list(box.visual.material.main_color) == [255, 0, 0, 255]
    assert ball.visual.material.roughnessFactor == 0.3
    # Other programs see a small PNG, SAPIEN the compressed image.
    document = read_glb(tmp_path / "b.glb").document
    kinds = [image["mimeType"] for image in document["images"]]
    assert kinds == ["image/png", "image/ktx2"]
    texture = document["textures"][0]
    assert texture["source"] == 0
    assert texture["extensions"] == {"KHR_texture_basisu": {"source": 1}}


def test_footprint_counts_what_sapien_loads_and_a_copy_of_a_copy_is_the_same(tmp_path):
    files = [textured_glb(tmp_path / "a.glb"), tmp_path / "b.glb", tmp_path / "c.glb"]
    for source, copy in pairwise(files):
        write_light_glb(source, AssetOptions(decimate=1.0), copy)
    assert files[2].read_bytes() == files[1].read_bytes()
    before, after = footprint(files[:1]), footprint(files[1:2])
    assert before.triangles == after.triangles == 5120 + 12
    assert before.texture_bytes == 64 * 64 * 4
    assert after.texture_bytes == 64 * 64 // 16 * 8
    meshes = trimesh.load_scene(files[0], process=False).dump()
    vertices = sum(len(mesh.vertices) for mesh in meshes)
    expected = VERTEX_BYTES * vertices + INDEX_BYTES * 3 * (5120 + 12)
    assert before.mesh_bytes == after.mesh_bytes == expected


@pytest.mark.slow
@pytest.mark.render
def test_sapien_draws_the_compressed_texture(tmp_path):
    blue = Image.new("RGB", (64, 64), (20, 40, 200))
    plate = trimesh.creation.box((1, 1, 1))
    uv = np.full((len(plate.vertices), 2), 0.5)
    plate.visual = TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=blue))
    trimesh.Scene(plate).export(tmp_path / "a.glb", file_type="glb")
    write_light_glb(tmp_path / "a.glb", AssetOptions(), tmp_path / "b.glb")
    colors = []
    for name in ("a.glb", "b.glb"):
        systems = [sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem(sapien.Device("cpu"))]
        scene = sapien.Scene(systems)
        scene.set_ambient_light([1, 1, 1])
        builder = scene.create_actor_builder()
        builder.add_visual_from_file(str(tmp_path / name))
        builder.initial_pose = sapien.Pose([2, 0, 0])
        builder.build_static("plate")
        camera = scene.add_camera("camera", 16, 16, 1.0, 0.1, 10)
        scene.update_render()
        camera.take_picture()
        color = camera.get_picture("Color")[8, 8, :3]
        # Bytes where an environment made before has chosen ManiSkill's shaders, which stay chosen.
        colors.append(color / 255 if color.dtype == np.uint8 else color)
    assert colors[0][2] > 4 * colors[0][0]
    assert np.allclose(*colors, atol=0.03)


def test_an_unreadable_texture_is_named(tmp_path):
    source = textured_glb(tmp_path / "cube.glb")
    good = source.read_bytes()
    png = good.index(b"\x89PNG")
    source.write_bytes(good[:png] + bytes(40) + good[png + 40 :])
    with pytest.raises(DatasetError, match=r"cube\.glb: its texture 0 cannot be read"):
        write_light_glb(source, AssetOptions(), tmp_path / "light.glb")
