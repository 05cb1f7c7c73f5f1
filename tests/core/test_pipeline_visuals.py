"""Light visual meshes: shape, texture and materials are kept; memory shrinks."""

import struct
from pathlib import Path

import numpy as np
import pytest
import sapien
import trimesh
from PIL import Image
from textured import sphere, textured_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from hab_tasks.errors import DatasetError
from hab_tasks.pipeline.decimate import FEWEST_TRIANGLES, Surface, thin
from hab_tasks.pipeline.footprint import INDEX_BYTES, VERTEX_BYTES, footprint
from hab_tasks.pipeline.glb import read_glb
from hab_tasks.pipeline.options import AssetOptions
from hab_tasks.pipeline.textures import ktx2
from hab_tasks.pipeline.visuals import write_light_glb

# Decimation ------------------------------------------------------------------------------------


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


def test_a_mesh_of_few_triangles_or_much_shape_keeps_them():
    surface, _ = sphere(2)
    assert len(surface.faces) < FEWEST_TRIANGLES
    assert np.array_equal(thin(surface, 0.1).position, surface.faces)
    rng = np.random.default_rng(0)
    mesh = trimesh.creation.icosphere(4)
    spiky = mesh.vertices * rng.uniform(0.5, 1.5, len(mesh.vertices))[:, None]
    surface = Surface(points=spiky, faces=np.asarray(mesh.faces), uv=None, normals=None)
    assert len(thin(surface, 0.1).faces) > 0.3 * len(mesh.faces)


# Textures and GLB files ------------------------------------------------------------------------


def test_ktx2_holds_blocks_of_eight_bytes():
    content = ktx2(Image.new("RGB", (16, 8), (200, 100, 50)))
    kind, _, width, height = struct.unpack_from("<4I", content, 12)
    assert (kind, width, height) == (132, 16, 8)  # VK_FORMAT_BC1_RGB_SRGB_BLOCK
    start, length = struct.unpack_from("<2Q", content, 80)
    assert length == (16 // 4) * (8 // 4) * 8
    assert (start % 8, start + length) == (0, len(content))
    # The first two bytes of a block are its colour in 5, 6 and 5 bits.
    packed = struct.unpack_from("<H", content, start)[0]
    color = (packed >> 11) * 255 / 31, (packed >> 5 & 63) * 255 / 63, (packed & 31) * 255 / 31
    assert np.allclose(color, (200, 100, 50), atol=8)


def test_a_light_glb_keeps_nodes_and_materials(tmp_path):
    turned = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [1, 0, 0])
    source = textured_glb(tmp_path / "a.glb", transform=turned)
    write_light_glb(source, AssetOptions(decimate=0.25, texture_px=32), tmp_path / "b.glb")
    before, after = (trimesh.load_scene(tmp_path / name) for name in ("a.glb", "b.glb"))
    assert np.allclose(before.bounds, after.bounds, atol=0.03)
    assert np.allclose(before.graph.get("ball")[0], after.graph.get("ball")[0])
    meshes = {len(mesh.faces): mesh for mesh in after.dump()}
    assert min(meshes) == 12
    assert max(meshes) == pytest.approx(1280, abs=4)
    assert list(meshes[12].visual.material.main_color) == [255, 0, 0, 255]
    assert meshes[max(meshes)].visual.material.roughnessFactor == 0.3
    # Other programs see a small PNG, SAPIEN the compressed image.
    document = read_glb(tmp_path / "b.glb").document
    kinds = [image["mimeType"] for image in document["images"]]
    assert kinds == ["image/png", "image/ktx2"]
    texture = document["textures"][0]
    assert texture["source"] == 0
    assert texture["extensions"] == {"KHR_texture_basisu": {"source": 1}}


def test_a_copy_of_a_copy_keeps_its_textures(tmp_path):
    write_light_glb(textured_glb(tmp_path / "a.glb", 256), AssetOptions(), tmp_path / "b.glb")
    write_light_glb(tmp_path / "b.glb", AssetOptions(decimate=1.0), tmp_path / "c.glb")
    assert (tmp_path / "c.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


def test_footprint_counts_what_sapien_loads(tmp_path):
    source = textured_glb(tmp_path / "a.glb")
    write_light_glb(source, AssetOptions(decimate=1.0), tmp_path / "b.glb")
    before, after = footprint([source]), footprint([tmp_path / "b.glb"])
    assert before.triangles == after.triangles == 5120 + 12
    assert before.texture_bytes == 64 * 64 * 4
    assert after.texture_bytes == 64 * 64 // 16 * 8
    assert before.mesh_bytes == after.mesh_bytes
    document = read_glb(source).document
    vertices = sum(
        document["accessors"][p["attributes"]["POSITION"]]["count"]
        for mesh in document["meshes"]
        for p in mesh["primitives"]
    )
    assert before.mesh_bytes == VERTEX_BYTES * vertices + INDEX_BYTES * 3 * (5120 + 12)


@pytest.mark.slow
@pytest.mark.render
def test_sapien_draws_the_compressed_texture(tmp_path):
    blue = Image.new("RGB", (64, 64), (20, 40, 200))
    plate = trimesh.creation.box((1, 1, 1))
    uv = np.full((len(plate.vertices), 2), 0.5)
    plate.visual = TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=blue))
    trimesh.Scene(plate).export(tmp_path / "a.glb", file_type="glb")
    write_light_glb(tmp_path / "a.glb", AssetOptions(), tmp_path / "b.glb")
    colors = [center_color(tmp_path / name) for name in ("a.glb", "b.glb")]
    assert colors[0][2] > 4 * colors[0][0]
    assert np.allclose(*colors, atol=0.03)


def center_color(file: Path) -> np.ndarray:
    """What a camera 2 m before a mesh sees in its middle."""
    systems = [sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem(sapien.Device("cpu"))]
    scene = sapien.Scene(systems)
    scene.set_ambient_light([1, 1, 1])
    builder = scene.create_actor_builder()
    builder.add_visual_from_file(str(file))
    builder.initial_pose = sapien.Pose([2, 0, 0])
    builder.build_static("plate")
    camera = scene.add_camera("camera", 16, 16, 1.0, 0.1, 10)
    scene.update_render()
    camera.take_picture()
    color = camera.get_picture("Color")[8, 8, :3]
    # Bytes where an environment made before has chosen ManiSkill's shaders, which stay chosen.
    return color / 255 if color.dtype == np.uint8 else color


def test_an_unreadable_texture_is_named(tmp_path):
    source = textured_glb(tmp_path / "cube.glb")
    good = source.read_bytes()
    png = good.index(b"\x89PNG")
    source.write_bytes(good[:png] + bytes(40) + good[png + 40 :])
    with pytest.raises(DatasetError, match=r"cube\.glb: its texture 0 cannot be read"):
        write_light_glb(source, AssetOptions(), tmp_path / "light.glb")
