"""The benchmarks' reference: ManiSkill's own scene environment with Fetch in ReplicaCAD."""

from __future__ import annotations

import json
import re
import shutil
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
import trimesh
from mani_skill.utils.scene_builder.replicacad import ReplicaCADSceneBuilder

from hab_eval.bench.process import BenchEnv, Motion, StepTiming, time_steps
from hab_eval.errors import BenchError
from hab_tasks.constants import CONTROL_HZ, SIM_HZ
from hab_tasks.errors import UnknownNameError

REFERENCE_ENV = "ReplicaCAD_SceneManipulation-v1"
REFERENCE_CONTROL = "pd_ee_delta_pos"
REFERENCE_EE_STEP_M = 0.1
"""Displacement of the end-effector for an action entry of 1 in `pd_ee_delta_pos`."""

REFERENCE_BASE_SPEEDS = (1.0, 3.14)
"""Forward [m/s] and turning velocity [rad/s] of the base for action entries of 1."""

SETTLE_STEPS = 10 * SIM_HZ
"""Ten seconds, in which the loose objects fall and settle; `hab_tasks` does this at scene load."""


@dataclass(frozen=True, kw_only=True)
class ReferenceFactory:
    """Creates the reference in its process, where MS_ASSET_DIR must be the copied dataset.

    Attributes:
        scenes: Scene ids; steps and soft resets are measured in the first.
        obs_mode: ManiSkill observation mode.
    """

    scenes: tuple[str, ...]
    obs_mode: str

    def __call__(self) -> BenchEnv:
        """Builds the environment."""
        return Reference(self.scenes, self.obs_mode)


class Reference:
    """ManiSkill's environment with the `BenchEnv` protocol."""

    def __init__(self, scenes: tuple[str, ...], obs_mode: str) -> None:
        class ListedScenes(ReplicaCADSceneBuilder):
            """Builds the requested scenes; ManiSkill's own list is incomplete."""

            def __init__(self, env: Any) -> None:
                super().__init__(env)
                self.build_configs = [f"{scene}{SCENE_SUFFIX}" for scene in scenes]
                self._navigable_positions = [None] * len(scenes)

        self._env: Any = gym.make(
            REFERENCE_ENV,
            scene_builder_cls=ListedScenes,
            build_config_idxs=[0],
            robot_uids="fetch",
            obs_mode=obs_mode,
            control_mode=REFERENCE_CONTROL,
            sim_config={"sim_freq": SIM_HZ, "control_freq": CONTROL_HZ},
            reconfiguration_freq=0,
            # The scene builder always adds lights, which needs a renderer.
            render_backend="cpu",
        )
        self._scene_count = len(scenes)
        self._scene = 0
        self._env.reset(seed=0)
        self._start = self._settled_state()

    @property
    def env(self) -> Any:
        """The environment."""
        return self._env

    def run_steps(self, motion: Motion) -> StepTiming:
        """See `BenchEnv`."""
        self._env.unwrapped.set_state_dict(self._start)
        self._env.unwrapped.agent.controller.reset()
        # The entries of gripper and body, between arm and base, stay zero.
        actions = torch.zeros(motion.count, self._env.action_space.shape[-1])
        actions[:, :3] = motion.arm_steps_m() / REFERENCE_EE_STEP_M
        actions[:, -2:] = motion.base_speeds() / torch.tensor(REFERENCE_BASE_SPEEDS)
        return time_steps(self._env, torch.zeros_like(actions[0]), actions)

    def soft_reset(self) -> float:
        """See `BenchEnv`."""
        started = time.perf_counter()
        self._env.reset()
        return time.perf_counter() - started

    def layouts(self) -> int:
        """See `BenchEnv`."""
        return self._scene_count

    def other_layout(self) -> float:
        """See `BenchEnv`."""
        self._scene = (self._scene + 1) % self._scene_count
        options = {"reconfigure": True, "build_config_idxs": [self._scene]}
        started = time.perf_counter()
        self._env.reset(seed=0, options=options)
        return time.perf_counter() - started

    def close(self) -> None:
        """See `BenchEnv`."""
        self._env.close()

    def _settled_state(self) -> Any:
        """Lets the loose objects settle and returns the state."""
        scene = self._env.unwrapped.scene
        for _ in range(SETTLE_STEPS):
            scene.step()
        return self._env.unwrapped.get_state_dict()


SCENE_SUFFIX = ".scene_instance.json"
LAYOUT = Path("data") / "scene_datasets" / "replica_cad_dataset"
"""Dataset folder of ManiSkill, below MS_ASSET_DIR."""

FLOOR_SIZE_M = (40.0, 0.1, 40.0)
"""Box that replaces the missing mesh of a stage; y is up in the dataset."""

PLACEHOLDER_SIZE_M = (0.05, 0.05, 0.05)
"""Box that replaces the missing mesh of an object."""

NUMBERS = re.compile(r'"[-+.,\s\deE]+"')
"""A quoted list of numbers, as in size="0.617 0.145, 0.894"."""


def scene_ids(dataset: Path) -> list[str]:
    """Returns the ids of all scenes of a dataset."""
    found = (dataset / "configs" / "scenes").glob(f"*{SCENE_SUFFIX}")
    return sorted(path.name.removesuffix(SCENE_SUFFIX) for path in found)


def check_scenes(dataset: Path, scenes: Iterable[str]) -> None:
    """Raises unless `dataset` is a ReplicaCAD folder with all `scenes`."""
    valid = scene_ids(dataset)
    if not valid:
        raise BenchError(f"{dataset}: not a ReplicaCAD folder, no configs/scenes/*{SCENE_SUFFIX}.")
    for scene in scenes:
        if scene not in valid:
            raise UnknownNameError(f"scene of {dataset}", scene, valid)


def make_layout(dataset: Path, scenes: Iterable[str], asset_dir: Path) -> None:
    """Writes the dataset with `scenes` below `asset_dir`."""
    target = asset_dir / LAYOUT
    shutil.copytree(dataset / "objects", target / "objects", copy_function=shutil.copyfile)
    for name in ("scenes", "objects"):
        source = dataset / "configs" / name
        shutil.copytree(source, target / "configs" / name, copy_function=shutil.copyfile)
    for scene in scenes:
        config = _read(target / "configs" / "scenes" / f"{scene}{SCENE_SUFFIX}")
        _add_stage(dataset, target, config)
        _add_articulations(dataset, target, config)
        _add_missing_objects(target, config)


def _add_stage(dataset: Path, target: Path, scene: Mapping[str, Any]) -> None:
    """Copies a scene's stage; a missing mesh is replaced with a floor."""
    name = Path(scene["stage_instance"]["template_name"]).name + ".glb"
    source, copy = dataset / "stages" / name, target / "stages" / name
    if source.is_file():
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, copy)
    else:
        below = trimesh.transformations.translation_matrix([0.0, -FLOOR_SIZE_M[1] / 2, 0.0])
        _write_box(copy, FLOOR_SIZE_M, below)


def _add_articulations(dataset: Path, target: Path, scene: Mapping[str, Any]) -> None:
    """Copies the articulated models to `urdf/<template>/<template>.urdf`."""
    sources = {path.stem: path for path in sorted((dataset / "urdf").glob("*/*.urdf"))}
    for articulation in scene["articulated_object_instances"]:
        template = Path(articulation["template_name"]).name
        folder = target / "urdf" / template
        if folder.exists():
            continue
        if template not in sources:
            raise UnknownNameError(f"articulation of {dataset}", template, sources)
        shutil.copytree(sources[template].parent, folder, copy_function=shutil.copyfile)
        urdf = folder / f"{template}.urdf"
        text = urdf.read_text(encoding="utf-8")
        # The files have commas, which NumPy 2 no longer reads as white space.
        urdf.write_text(NUMBERS.sub(lambda m: m.group().replace(",", " "), text), encoding="utf-8")


def _add_missing_objects(target: Path, scene: Mapping[str, Any]) -> None:
    """Writes a small box for each missing mesh."""
    configs = target / "configs" / "objects"
    for instance in scene["object_instances"]:
        config = _read(configs / f"{Path(instance['template_name']).name}.object_config.json")
        for key in ("render_asset", "collision_asset"):
            mesh = (configs / config[key]).resolve() if key in config else None
            if mesh is not None and not mesh.is_file():
                _write_box(mesh, PLACEHOLDER_SIZE_M, trimesh.transformations.identity_matrix())


def _write_box(path: Path, size_m: tuple[float, float, float], pose: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Scene(trimesh.creation.box(extents=size_m, transform=pose)).export(path)


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))
