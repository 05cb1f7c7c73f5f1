"""Suite rays: depth images computed on the CPU, compared with a software renderer."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_eval.bench.comparison import alternate, hab_env, motions, reference, step_rows
from hab_eval.bench.hab_env import HabBenchEnv, HabEnvFactory, actions_of
from hab_eval.bench.process import Motion, RemoteEnv, StepTiming
from hab_eval.bench.report import BenchRow, bound_row, make_row
from hab_eval.bench.suite import DENSE_SCENE, FIRST_SCENE, PICK, BenchOptions, Suite, WriteLine
from hab_tasks.constants import CAMERA_DEPTH_MAX_M
from hab_tasks.io.pool import WorkerPool, in_order

RENDERER = "software renderer"
HOLDING = "HabPlace-v1"
"""The accuracy is measured with an object in the hand."""

TIMED_SCENES = 2
"""Speed is measured in the first scenes only; accuracy in all."""

MEDIAN_BOUND_MM = 1.0
FAR_OFF_MM, FAR_OFF_BOUND_PERCENT = 10.0, 1.0

ONE_CORE = {"LP_NUM_THREADS": "0"}
"""Mesa's software renderer then draws in the calling thread."""

SCENES = (
    *(FIRST_SCENE, DENSE_SCENE, "apt_1"),
    *(f"v3_sc{macro}_staging_{number}" for number in ("05", "10", "15") for macro in range(2)),
    "v3_sc2_staging_10",
)


@dataclass(frozen=True, kw_only=True)
class ImageFactory:
    """Creates an `ImageEnv` in its process.

    Attributes:
        env: The environment, with depth observations.
        one_core: Whether the process is restricted to one core.
    """

    env: HabEnvFactory
    one_core: bool

    def __call__(self) -> ImageEnv:
        """Builds the environment."""
        if self.one_core:
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        return ImageEnv(self.env)


class ImageEnv(HabBenchEnv):
    """An environment of which only the images are timed."""

    def __init__(self, factory: HabEnvFactory) -> None:
        super().__init__(factory)
        self._env.unwrapped.leave_out_images()

    def run_steps(self, motion: Motion) -> StepTiming:
        """Times the images of all cameras after each step; a step counts as one."""
        self._reset(reconfigure=False)
        episode = self._episodes[self._scene][self._episode]
        base, total_s = self._env.unwrapped, 0.0
        base.look()  # the first images of a layout prepare its meshes
        for action in actions_of(self._env_id, motion, episode)[:, None]:
            self._env.step(action)
            started = time.perf_counter()
            base.look()
            total_s += time.perf_counter() - started
        return StepTiming(steps=motion.count, total_s=total_s, engine_s=0.0)


class ImageProcesses:
    """Environments in independent processes that compute images at the same time."""

    def __init__(self, options: BenchOptions, scene: str, backend: str, count: int) -> None:
        """Starts `count` processes; a single one on one core."""
        env = HabEnvFactory.of(options, PICK, (scene,), obs_mode="depth", render_backend=backend)
        factory = ImageFactory(env=env, one_core=count == 1)
        variables = ONE_CORE if count == 1 else {}
        self._envs = [RemoteEnv(factory, variables) for _ in range(count)]

    def run_steps(self, count: int, seed: int) -> float:
        """Returns the total number of image pairs per second."""
        motion = motions(PICK)[1](count, seed)
        for env in self._envs:
            env.start_steps(motion)
        timings = [env.finish_steps() for env in self._envs]
        return len(timings) * count / max(timing.total_s for timing in timings)

    def close(self) -> None:
        """Ends the processes."""
        for env in self._envs:
            env.close()


def run_rays(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures speed in the first scenes, and accuracy in all."""
    rows: list[BenchRow] = []
    scenes = [scene for group in options.groups for scene in group]
    for scene in scenes[:TIMED_SCENES]:
        for variant, count in (("one_core", 1), ("two_processes", 2)):
            rows.append(_image_row(options, scene, variant, count, write_line))
        rows.append(_step_row(options, scene, write_line))
    return [*rows, *_accuracy_rows(options, scenes, write_line)]


def _image_row(
    options: BenchOptions, scene: str, variant: str, count: int, write_line: WriteLine
) -> BenchRow:
    """Compares the speed of the images alone; processes run alternately."""
    pairs = []
    with ExitStack() as stack:
        rays, renderer = (
            stack.enter_context(closing(ImageProcesses(options, scene, backend, count)))
            for backend in ("rays", "cpu")
        )
        steps = options.step_count
        for env in (rays, renderer):
            env.run_steps(steps, 0)
        for repeat in range(options.repeats):
            pairs.append((rays.run_steps(steps, repeat), renderer.run_steps(steps, repeat)))
            shown = f"rays {pairs[-1][0]:.1f} image pairs/s, renderer {pairs[-1][1]:.1f}"
            write_line(f"{scene}, {variant}, repeat {repeat + 1}: {shown}")
    name = ("rays", scene, PICK, variant)
    values, references = [a for a, _ in pairs], [b for _, b in pairs]
    return make_row(name, values, references, unit="image pairs/s", reference=RENDERER)


def _step_row(options: BenchOptions, scene: str, write_line: WriteLine) -> BenchRow:
    """Compares steps with two depth cameras with ManiSkill."""
    with (
        reference(options, (scene,), obs_mode="depth") as reference_env,
        hab_env(options, PICK, (scene,), obs_mode="depth", render_backend="rays") as env,
    ):
        pairs = alternate(options, motions(PICK)[1], env, reference_env, write_line)
    return step_rows(("rays", scene, PICK, "two_cameras"), pairs)[0]


def _accuracy_rows(
    options: BenchOptions, scenes: Sequence[str], write_line: WriteLine
) -> list[BenchRow]:
    """Compares images in all scenes, with the robot and a held object, pixel by pixel."""
    medians_mm, far_off_percent = [], []
    arguments = (differences_mm, options.scene_dataset, options.objects)
    with WorkerPool(1, partial, arguments) as pool:
        for scene, found in zip(scenes, in_order(pool.run(scenes)), strict=True):
            medians_mm += [float(np.median(view)) for view in found]
            far_off_percent += [100.0 * float(np.mean(view > FAR_OFF_MM)) for view in found]
            write_line(f"{scene}: {len(found)} views compared with the renderer")
    name = ("rays", f"{len(scenes)}_scenes", HOLDING)
    mean_percent = [float(np.mean(far_off_percent))]
    views = len(medians_mm)
    write_line(f"{views} views; worst view {max(far_off_percent):.3f} % of pixels over 1 cm")
    return [
        bound_row((*name, "median_difference"), medians_mm, MEDIAN_BOUND_MM, unit="mm"),
        bound_row((*name, "pixels_over_1_cm"), mean_percent, FAR_OFF_BOUND_PERCENT, unit="%"),
    ]


def differences_mm(
    scene_dataset: Path, objects: Path | None, scene: str
) -> list[NDArray[np.float32]]:
    """Returns the absolute depth difference (H, W) [mm] of each view of a scene.

    Args:
        scene_dataset: The ReplicaCAD folder.
        objects: A YCB folder, None for the shipped objects.
        scene: Scene id; two episodes with two cameras each.
    """
    views: list[list[NDArray[np.float32]]] = []
    for backend in ("rays", "cpu"):
        factory = HabEnvFactory(
            env_id=HOLDING,
            scene_dataset=str(scene_dataset),
            objects=None if objects is None else str(objects),
            scenes=(scene,),
            obs_mode="depth",
            render_backend=backend,
        )
        env = factory.make_env()
        views.append(list(_views_mm(env, factory)))
        env.close()
    return [np.abs(rays - rendered) for rays, rendered in zip(*views, strict=True)]


def _views_mm(env: Any, factory: HabEnvFactory) -> Iterator[NDArray[np.float32]]:
    """Yields the depth images (H, W) [mm] after a few steps of each episode."""
    for episode in factory.episodes_in(factory.scenes[0]):
        env.reset(seed=episode.seed, options={"episode": episode})
        motion = Motion(count=5, seed=episode.seed % 2**31)
        for action in actions_of(factory.env_id, motion, episode)[:, None]:
            obs, *_ = env.step(action)
        for images in obs["sensor_data"].values():
            yield 1e3 * CAMERA_DEPTH_MAX_M * images["depth"][0, :, :, 0].numpy()


SUITE = Suite(name="rays", run=run_rays, steps=40, groups=tuple((scene,) for scene in SCENES))
