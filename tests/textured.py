"""Textured meshes, and a small dataset that contains some."""

from pathlib import Path

import numpy as np
import trimesh
from builders import tiny_dataset
from hab_authoring.pipeline.decimate import Surface
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from hab_tasks.world.scenes.habitat.dataset import SceneDataset


def sphere(subdivisions: int = 4) -> tuple[Surface, np.ndarray]:
    """A unit sphere whose halves have textures of their own, and each vertex's half."""
    mesh = trimesh.creation.icosphere(subdivisions)
    upper = mesh.triangles_center[:, 2] > 0
    halves = [mesh.submesh([np.flatnonzero(side)], append=True) for side in (upper, ~upper)]
    points = np.concatenate([half.vertices for half in halves])
    count = len(halves[0].vertices)
    faces = np.concatenate([halves[0].faces, halves[1].faces + count])
    half = (np.arange(len(points)) >= count).astype(int)
    uv = np.column_stack((0.5 * half + 0.2 + 0.2 * points[:, 0], 0.5 + 0.2 * points[:, 1]))
    return Surface(points=points, faces=faces, uv=uv, normals=points.copy()), half


def textured_glb(path: Path, size_px: int = 64, transform: np.ndarray | None = None) -> Path:
    """A sphere with a texture of noise, and beside it a plain red box."""
    surface, _ = sphere()
    pixels = np.random.default_rng(0).integers(0, 255, (size_px, size_px, 3), dtype=np.uint8)
    ball = trimesh.Trimesh(surface.points, surface.faces, process=False)
    material = PBRMaterial(baseColorTexture=Image.fromarray(pixels), roughnessFactor=0.3)
    ball.visual = TextureVisuals(uv=surface.uv, material=material)
    box = trimesh.creation.box((0.5, 0.5, 0.5))
    box.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[255, 0, 0, 255]))
    scene = trimesh.Scene()
    scene.add_geometry(ball, node_name="ball", transform=transform)
    scene.add_geometry(
        box, node_name="box", transform=trimesh.transformations.translation_matrix([3, 0, 0])
    )
    scene.export(path, file_type="glb")
    return path


def box_at(*center: float, size: tuple[float, float, float] = (1, 1, 1)) -> trimesh.Trimesh:
    transform = trimesh.transformations.translation_matrix(center)
    return trimesh.creation.box(size, transform)


def textured_dataset(root: Path) -> SceneDataset:
    """The tiny dataset with a licence, a textured cube and a chest that collides as a mesh."""
    tiny_dataset(root)
    (root / "LICENSE.txt").write_text("Only for tests.")
    textured_glb(root / "objects/cube.glb")
    (root / "objects/cube.glb.convex.stl").write_text("SAPIEN's own cache")
    urdf = root / "urdf/chests/chest.urdf"
    place = '<origin xyz="1, 0, 0" rpy="0 0 1.5707963267948966"/>'
    mesh = place + '<geometry><mesh filename="body.glb" scale="2 1 1"/>'
    urdf.write_text(urdf.read_text().replace('<geometry><box size="0.4 0.3, 0.2"/>', mesh))
    return SceneDataset(root)
