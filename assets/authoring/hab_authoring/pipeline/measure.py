"""Compares a dataset with its optimised copy: memory of the visual meshes, and depth images.

Memory of every visual of all layouts (objects and furniture, each file once) is measured on a
process that loads them into SAPIEN and draws them by software Vulkan, and counted from the files
(`hab-tasks assets` prints such a count too, with those visuals that no layout shows). Depth is
compared in views from the robot's head camera at random places of several layouts.

    python -m hab_authoring.pipeline.measure ~/data/replica_cad ~/data/light --views 20
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import trimesh
import tyro

from hab_authoring.pipeline.optimise import footprint
from hab_authoring.showroom import Showroom
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.errors import DatasetError, HabError, RenderingUnavailableError
from hab_tasks.geometry import Array, Pose7, planar
from hab_tasks.rendering import ADVICE, software_vulkan_works, use_default_shaders
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.robots.cameras import camera_pose
from hab_tasks.world.navigation import NavigationMap
from hab_tasks.world.scenes.build import to_sapien
from hab_tasks.world.scenes.fields import read_json, read_urdf
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene, load_template
from hab_tasks.world.scenes.layout_geometry import Layout
from hab_tasks.world.scenes.spec import SceneSpec
from hab_tasks.world.scenes.urdf_checks import mesh_file

logger = logging.getLogger(__name__)

PROBE = Path(__file__).with_name("memory_probe.py")
LAYOUTS = 5
MB = 1e6

MEASURED = {
    "counted": "counted from the files",
    "trimmed": "of a process on software Vulkan",
    "process": "with what its allocator keeps in stock",
}
"""What each figure of `Memory` is."""


@dataclass(frozen=True, kw_only=True)
class Memory:
    """Memory of a dataset's visual meshes.

    Attributes:
        process_bytes: By how much a process on software Vulkan grew when it loaded and drew them.
            What its allocator keeps in stock counts, so that this varies.
        trimmed_bytes: The same after the allocator has returned its stock.
        counted_bytes: Vertices, indices and texture pixels, counted from the files (`Footprint`).
    """

    process_bytes: int
    trimmed_bytes: int
    counted_bytes: int


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A dataset and its copy.

    Attributes:
        original: Memory of the original's visual meshes.
        copy: Memory of the copy's.
        depth_difference_m: Mean difference of depth of each view.
        mean_depth_difference_m: Their mean.
    """

    original: Memory
    copy: Memory
    depth_difference_m: tuple[float, ...]
    mean_depth_difference_m: float


def compare(
    original: SceneDataset,
    copy: SceneDataset,
    *,
    views: int = 20,
    seed: int = 0,
    scenes: Sequence[str] | None = None,
) -> Comparison:
    """Measures memory and depth images of a dataset and its copy.

    Args:
        original: The dataset.
        copy: Its copy, with the same layouts.
        views: Number of views.
        seed: Seed of their places.
        scenes: Only the visual meshes and views of these layouts.

    Raises:
        RenderingUnavailableError: No software Vulkan to draw with.
        DatasetError: The copy lacks a layout.
    """
    if not software_vulkan_works():
        raise RenderingUnavailableError(ADVICE)
    scenes = list(original.scene_files) if scenes is None else list(scenes)
    before, after = (memory(visual_files(dataset, scenes)) for dataset in (original, copy))
    shown = [scenes[i] for i in np.unique(np.linspace(0, len(scenes) - 1, LAYOUTS).astype(int))]
    differences = depth_differences_m(original, copy, shown, views, np.random.default_rng(seed))
    return Comparison(
        original=before,
        copy=after,
        depth_difference_m=tuple(differences),
        mean_depth_difference_m=float(np.mean(differences)),
    )


def visual_files(dataset: SceneDataset, scenes: Iterable[str]) -> list[Path]:
    """Returns the visual meshes of everything in some layouts: stage, objects and furniture."""
    found: set[Path] = set()
    for scene_id in scenes:
        data = read_json(dataset.scene_file(scene_id))
        for entry in data.get("object_instances", []):
            name = Path(entry["template_name"]).name.removesuffix(".object_config.json")
            template = load_template(dataset.object_files[name])
            found |= {template.visual_file} if template and template.visual_file else set()
        for entry in data.get("articulated_object_instances", []):
            found |= _urdf_visuals(dataset.urdf_files[Path(entry["template_name"]).name])
        stage = load_scene(dataset, scene_id).stage
        found |= {stage.visual_file} if stage.visual_file else set()
    return sorted(found)


def memory(files: Sequence[Path]) -> Memory:
    """Returns the memory of visual meshes, each loaded once."""
    with tempfile.TemporaryDirectory() as folder:
        warm_up = Path(folder) / "warm_up.glb"
        trimesh.Scene(trimesh.creation.box()).export(warm_up, file_type="glb")
        done = subprocess.run(
            [sys.executable, str(PROBE)],
            input=json.dumps([str(warm_up), *map(str, files)]),
            capture_output=True,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
    if done.returncode != 0:
        raise DatasetError(f"{files[0]} and others: not loaded ({done.stderr.strip()[-500:]}).")
    growth = json.loads(done.stdout.splitlines()[-1])
    return Memory(
        process_bytes=growth["bytes"],
        trimmed_bytes=growth["bytes_trimmed"],
        counted_bytes=footprint(files).total_bytes,
    )


def depth_differences_m(
    original: SceneDataset,
    copy: SceneDataset,
    scenes: Sequence[str],
    views: int,
    rng: np.random.Generator,
) -> list[float]:
    """Returns the mean absolute difference of depth [m] of views spread over some layouts."""
    cameras = HeadCamera(), HeadCamera()
    found = []
    for number, scene_id in enumerate(scenes):
        specs = [load_scene(dataset, scene_id) for dataset in (original, copy)]
        for camera, spec in zip(cameras, specs, strict=True):
            camera.show(spec)
        count = len(range(number, views, len(scenes)))
        for place in base_poses(specs[0], count, rng):
            first, second = (camera.depth_m(place) for camera in cameras)
            found.append(float(np.abs(first - second).mean()))
    return found


def _urdf_visuals(urdf: Path) -> set[Path]:
    meshes = read_urdf(urdf).iterfind("link/visual/geometry/mesh")
    return {mesh_file(urdf, mesh) for mesh in meshes}


@dataclass(frozen=True, kw_only=True)
class _Options:
    """Compares memory and depth images of a dataset with those of its optimised copy.

    Memory of all visuals that its layouts show, each file once: counted from the files, and the
    growth of a process that draws them by software Vulkan. Movable objects (YCB) are left out.
    """

    original: tyro.conf.Positional[str]
    """Path of the dataset."""
    copy: tyro.conf.Positional[str]
    """Path of its copy."""
    views: int = 20
    """Number of views."""
    seed: int = 0
    """Seed of their places."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Where all figures go."""


def main() -> int:
    """Runs the comparison from the command line; returns the exit status."""
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
    options = tyro.cli(_Options, prog="python -m hab_authoring.pipeline.measure")
    try:
        found = compare(
            resolve_dataset(options.original),
            resolve_dataset(options.copy),
            views=options.views,
            seed=options.seed,
        )
    except HabError as error:
        logger.error(error)
        return 2
    for name, meaning in MEASURED.items():
        before, after = (getattr(m, f"{name}_bytes") for m in (found.original, found.copy))
        logger.info(
            "memory, %s: %.1f MB -> %.1f MB, %.1f times smaller",
            meaning,
            before / MB,
            after / MB,
            before / after,
        )
    logger.info("mean depth difference: %.2f mm", 1000 * found.mean_depth_difference_m)
    if options.json is not None:
        options.json.write_text(json.dumps(asdict(found), indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())


NEAR_M = 0.01


def base_poses(spec: SceneSpec, count: int, rng: np.random.Generator) -> list[Pose7]:
    """Returns random poses of the robot's base on the free floor of a layout."""
    navigation = NavigationMap.of_layout(Layout.of(spec))
    cells = np.argwhere(navigation.free)
    chosen = navigation.positions(cells[rng.integers(len(cells), size=count)])
    yaws = rng.uniform(-np.pi, np.pi, size=count)
    return [planar(x, y, yaw) for (x, y), yaw in zip(chosen.tolist(), yaws.tolist(), strict=True)]


class HeadCamera(Showroom):
    """Renders one layout after another with the parameters of the robot's head camera."""

    def __init__(self) -> None:
        super().__init__("cpu")
        use_default_shaders()
        self._camera = self.scene.add_camera(
            "head", CAMERA_SIZE_PX, CAMERA_SIZE_PX, CAMERA_HFOV_RAD, NEAR_M, CAMERA_DEPTH_MAX_M
        )
        self._base_from_camera = camera_pose(DEFAULT_ROBOT.cameras["head"])

    def depth_m(self, world_from_base: Pose7) -> Array:
        """Returns the depth (H, W) [m]; the maximum without a hit."""
        self._camera.entity.set_pose(to_sapien(world_from_base) * self._base_from_camera)
        self.scene.update_render()
        self._camera.take_picture()
        position = self._camera.get_picture("Position")
        depth = -position[..., 2].astype(float)
        return np.where(position[..., 3] < 1.0, depth, CAMERA_DEPTH_MAX_M)
