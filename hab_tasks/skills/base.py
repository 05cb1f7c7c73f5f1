"""What every skill is made of, and the environment that runs one: the order of calls, no more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs.types import SimConfig
from torch import Tensor

from hab_tasks.constants import CONTROL_HZ, SIM_HZ
from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import EpisodeRequest, open_source
from hab_tasks.errors import ActionError, UnknownNameError
from hab_tasks.measures import Measures
from hab_tasks.rendering import resolve_backend, sensor_shader
from hab_tasks.rewards import total
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.sensors import ObsEntry, scale_depth
from hab_tasks.skills.viewpoint import viewpoint
from hab_tasks.skills.world import World
from hab_tasks.snapshot import Snapshot

RENDER_SIZE_PX = 512

WITHOUT_IMAGES = ("state", "state_dict", "none")
"""Observation modes that need no renderer."""


@dataclass(frozen=True, kw_only=True)
class Skill:
    """A skill as data and pure functions; a new skill is one file with one of these.

    Attributes:
        observation: Entries of the state observation, in order.
        success: (snapshot, measures, config) -> (N,) bool.
        failures: (snapshot, measures, config) -> name -> (N,) bool.
        reward_terms: (snapshot, measures, goals, config, ends) -> name -> (N,) float32; `ends`
            holds ``success`` and every failure.
        mask_gripper: (gripper, measures) -> the gripper entry that is carried out, (N,).
        reward_bound: No step can pay more; divides the normalised reward.
    """

    name: str
    config: Any
    horizon_steps: int
    control_modes: tuple[str, ...]
    observation: tuple[ObsEntry, ...]
    success: Callable[[Snapshot, Measures, Any], Tensor]
    failures: Callable[[Snapshot, Measures, Any], dict[str, Tensor]]
    reward_terms: Callable[..., dict[str, Tensor]]
    mask_gripper: Callable[[Tensor, Measures], Tensor]
    reward_bound: float


class SkillEnv(BaseEnv):
    """Runs a `Skill` on episodes of a scene dataset; all rows of a batch play in one layout.

    Args:
        scene_dataset: ``apartment`` or the path of a ReplicaCAD folder.
        objects: Path of a YCB folder; None for the embedded objects.
        split: ``train``, ``val`` or ``test``; None for the most unseen one that the dataset has.
        scene: Only episodes in this layout.
        episodes: An episode file instead of generated episodes.
        num_episodes: How many episodes of the split to draw from.
        episode_seed: Seed of the generated episodes.
        novel: ``objects`` or ``receptacles`` kept for evaluation (S E.1) instead of the usual ones.
        prefetch: Build all layouts of the split at the start, so that none is waited for later.
        render_backend: ``auto``, ``none``, ``cpu`` or ``gpu``; `auto` renders only when needed.
        kwargs: ManiSkill's own arguments (obs_mode, reward_mode, control_mode, num_envs, ...).
    """

    SUPPORTED_ROBOTS: ClassVar[list[str]] = ["hab_fetch"]  # type: ignore[assignment]
    SUPPORTED_REWARD_MODES = ("dense", "normalized_dense", "sparse", "none")
    skill: ClassVar[Skill]
    agent: HabFetch  # type: ignore[assignment]
    _viewpoint_of: tuple[Episode, ...] = ()

    def __init__(
        self,
        *,
        scene_dataset: str | Path = "apartment",
        objects: str | Path | None = None,
        split: str | None = None,
        scene: str | None = None,
        episodes: str | Path | None = None,
        num_episodes: int = 50,
        episode_seed: int = 0,
        novel: str | None = None,
        prefetch: bool = False,
        control_mode: str | None = None,
        obs_mode: str | None = None,
        render_mode: str | None = None,
        render_backend: str = "auto",
        num_envs: int = 1,
        **kwargs: Any,
    ) -> None:
        kwargs.setdefault("robot_uids", "hab_fetch")
        request = EpisodeRequest(
            env_id=self.default_id(),
            scene_dataset=scene_dataset,
            objects=objects,
            split=split,
            scene=scene,
            file=episodes,
            seed=episode_seed,
            novel=novel,
        )
        self._world = World(open_source(request), num_episodes, num_envs, prefetch=prefetch)
        self._backend = resolve_backend(render_backend, _needs_images(obs_mode, render_mode))
        super().__init__(
            num_envs=num_envs,
            obs_mode=obs_mode,
            control_mode=self._known_mode(control_mode),
            render_mode=render_mode,
            render_backend=self._backend,
            **kwargs,
        )

    @classmethod
    def _known_mode(cls, control_mode: str | None) -> str:
        """Returns the control mode, the skill's first one for None; refuses any other."""
        modes = cls.skill.control_modes
        if control_mode is not None and control_mode not in modes:
            raise UnknownNameError(f"control_mode of {cls.skill.name}", control_mode, modes)
        return control_mode or modes[0]

    @classmethod
    def default_id(cls) -> str:
        """Returns the registered id of this class."""
        return f"{cls.__name__.removesuffix('Env')}-v1"

    @property
    def episode(self) -> tuple[Episode, ...]:
        """The episode that each row plays."""
        return tuple(self._world.episodes)

    @property
    def measures(self) -> Measures:
        """The measures after the latest control step."""
        return self._world.tracker.measures

    def privileged(self) -> list[Any]:
        """Returns the true state of each row (see `hab_tasks.privileged`)."""
        return self._world.privileged()

    # Building and resetting ------------------------------------------------------------------

    @property
    def _default_sim_config(self) -> SimConfig:
        return SimConfig(sim_freq=SIM_HZ, control_freq=CONTROL_HZ)

    @property
    def _default_human_render_camera_configs(self) -> CameraConfig:  # type: ignore[override]
        return CameraConfig(
            uid="render_camera",
            pose=sapien.Pose(),  # type: ignore[arg-type]  # set by render_rgb_array
            width=RENDER_SIZE_PX,
            height=RENDER_SIZE_PX,
            fov=1.2,
            near=0.05,
            far=50.0,
            mount=self.agent.link("base_link"),
        )

    def reset(
        self, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts episodes.

        Args:
            seed: Chooses the episodes; the same seed gives the same ones.
            options: ManiSkill's own, and ``episode``: an `Episode` or its index in the set, or a
                list with one for each row.
        """
        options = dict(options or {})
        rows = options.get("env_idx")
        rows = list(range(self.num_envs)) if rows is None else [int(row) for row in rows]
        rebuild = self._world.choose(rows, seed, options.pop("episode", None))
        if rebuild:
            options["reconfigure"] = True
        return super().reset(seed=seed, options=options)

    def render_rgb_array(self, camera_name: str | None = None) -> Any:
        """Renders the third-person camera, put where no wall hides the robot."""
        if self._viewpoint_of != self.episode:
            bodies = {state.scene_key: state for state in self._world.privileged()}
            for state in bodies.values():
                pose = viewpoint(state)
                for camera in self._human_render_cameras["render_camera"].camera._render_cameras:
                    camera.local_pose = pose
            self._viewpoint_of = self.episode
        return super().render_rgb_array(camera_name)  # pyright: ignore[reportArgumentType]  # None is its default

    def _load_scene(self, options: dict[str, Any]) -> None:
        self._viewpoint_of = ()
        # Depth needs no light, and lamps cost a software renderer a quarter of its time.
        coloured = self.render_mode is not None or self._wants_colour
        self._world.build(self.scene, self.agent, lit=coloured and self.scene.can_render())

    @property
    def _wants_colour(self) -> bool:
        visual = self.obs_mode_struct.visual
        other = self.obs_mode in ("pointcloud", "sensor_data")
        return other or visual.rgb or visual.normal or visual.albedo

    def _setup_sensors(self, options: dict[str, Any]) -> None:
        self._custom_sensor_configs = sensor_shader(
            self._custom_sensor_configs or {}, self._backend, self._wants_colour
        )
        super()._setup_sensors(options)

    def _load_lighting(self, options: dict[str, Any]) -> None:
        """Leaves out ManiSkill's lamps: the world shows the layout's own."""

    def _clear_sim_state(self) -> None:
        # On the CPU the episode sets all velocities itself, and frozen bodies have none.
        if self.gpu_sim_enabled:
            super()._clear_sim_state()

    def _initialize_episode(self, env_idx: Tensor, options: dict[str, Any]) -> None:
        self._world.apply(env_idx)
        self.__dict__.pop("segmentation_id_map", None)  # made anew: other bodies may be shown

    # Stepping --------------------------------------------------------------------------------

    def _step_action(self, action: np.ndarray | Tensor | None) -> Tensor | None:
        """Carries out one action; reads the simulator once; advances the tracker once."""
        if action is not None:
            action = self._batched(action)
            self.agent.controller.set_action(action)
            if self.gpu_sim_enabled:
                px: Any = self.scene.px
                px.gpu_apply_articulation_target_position()
                px.gpu_apply_articulation_target_velocity()
        gripper = self.skill.mask_gripper(self.agent.controller.gripper, self.measures)
        self._world.step(gripper, self._sim_steps_per_control)
        return action

    def _batched(self, action: np.ndarray | Tensor) -> Tensor:
        try:
            tensor = torch.as_tensor(action, dtype=torch.float32, device=self.device)
        except (TypeError, ValueError, RuntimeError) as error:
            raise ActionError(f"Action {action!r} is not an array of numbers ({error}).") from error
        return tensor[None] if tensor.dim() == 1 and self.num_envs == 1 else tensor

    def evaluate(self) -> dict[str, Any]:
        """Success, failure, measures and reward terms of the present moment; changes nothing."""
        snapshot, measures, skill = self._world.snapshot, self.measures, self.skill
        failures = skill.failures(snapshot, measures, skill.config)
        success = skill.success(snapshot, measures, skill.config)
        fail = reduce(torch.logical_or, failures.values())
        success = success & ~fail
        terms = skill.reward_terms(
            snapshot, measures, self._world.goals, skill.config, {"success": success, **failures}
        )
        return {
            "success": success,
            "fail": fail,
            "failures": failures,
            "measures": measures.as_dict(),
            "reward_terms": terms,
        }

    def compute_dense_reward(self, obs: Any, action: Tensor, info: dict[str, Any]) -> Tensor:
        """Returns the sum of the reward terms, (N,)."""
        return total(info["reward_terms"])

    def compute_normalized_dense_reward(
        self, obs: Any, action: Tensor, info: dict[str, Any]
    ) -> Tensor:
        """Returns the dense reward divided by its bound, never above 1, (N,)."""
        return (total(info["reward_terms"]) / self.skill.reward_bound).clamp(max=1.0)

    # Observations ----------------------------------------------------------------------------

    def _get_obs_agent(self) -> dict[str, Tensor]:
        return {"arm_qpos": self._world.snapshot.arm_qpos_rad.clone()}

    def _get_obs_extra(self, info: dict[str, Any]) -> dict[str, Tensor]:
        snapshot, measures, goals = self._world.snapshot, self.measures, self._world.goals
        return {
            entry.name: entry.read(snapshot, measures, goals)
            for entry in self.skill.observation
            if entry.name != "arm_qpos"
        }

    def _get_obs_sensor_data(self, apply_texture_transforms: bool = True) -> dict[str, Any]:
        data = super()._get_obs_sensor_data(apply_texture_transforms)
        if self.obs_mode_struct.visual.depth and apply_texture_transforms:
            for images in data.values():
                images["depth"] = scale_depth(images["depth"])
        return data

    # State -----------------------------------------------------------------------------------

    def get_state_dict(self) -> dict[str, Any]:
        """Returns the simulator's state and the episode's, enough to go on from here."""
        simulator: Any = super().get_state_dict()
        return {**simulator, "hab": self._world.get_state()}

    def set_state_dict(self, state: dict[str, Any], env_idx: Tensor | None = None) -> None:
        """Restores what `get_state_dict` returned."""
        rows = torch.arange(self.num_envs, device=self.device) if env_idx is None else env_idx
        self._world.thaw()
        simulator = {key: value for key, value in state.items() if key != "hab"}
        super().set_state_dict(simulator, env_idx)  # pyright: ignore[reportArgumentType]  # None is its default
        self._world.set_state(state["hab"], rows)


def _needs_images(obs_mode: str | None, render_mode: str | None) -> bool:
    return render_mode is not None or (obs_mode or "state") not in WITHOUT_IMAGES
