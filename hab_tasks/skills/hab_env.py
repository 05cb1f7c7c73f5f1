"""The environment that all skills and tasks are: the order of calls, no more."""

from __future__ import annotations

import inspect
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import torch
from gymnasium.envs.registration import EnvSpec
from mani_skill.utils.structs.types import SimConfig
from torch import Tensor

from hab_tasks.agent import TargetFrame
from hab_tasks.arrays import Rows, to_info
from hab_tasks.constants import CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import EpisodeRequest, open_source
from hab_tasks.errors import ActionError, UnknownNameError
from hab_tasks.measures import Measures
from hab_tasks.noise import NoiseSource, SensorNoise
from hab_tasks.option_values import entries, flag, row_numbers, seeds
from hab_tasks.rewards import total
from hab_tasks.robots.delay import ActionDelay, checked_steps
from hab_tasks.scenes.physics import sim_config
from hab_tasks.skills.inherited_options import check_inherited
from hab_tasks.skills.needs import Needs
from hab_tasks.skills.observing_env import ObservingEnv
from hab_tasks.skills.recorded_state import shaped_like, with_columns
from hab_tasks.skills.world import World
from hab_tasks.snapshot import Snapshot

PACKAGE = "hab_tasks"
"""What Gymnasium imports before it makes one of these environments."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the rules say of one moment.

    Attributes:
        success: (N,) whether the goal is reached, failures left aside.
        failures: Name -> (N,) bool; any of them ends the episode.
        reward_terms: (ends) -> name -> (N,) float32; `ends` holds ``success`` and every failure.
        measures: (success) -> name -> (N,), shown in `info`.
        unpaid: Terms that this moment cannot pay, zero (N,); shown with the others.
        extra: Further entries of `info`: name -> name -> (N,).
    """

    success: Rows
    failures: dict[str, Rows]
    reward_terms: Callable[[dict[str, Rows]], dict[str, Rows]]
    measures: Callable[[Rows], dict[str, Rows]]
    extra: dict[str, dict[str, Rows]] = field(default_factory=dict)
    unpaid: dict[str, Tensor] = field(default_factory=dict)


class HabEnv(ObservingEnv):
    """Plays episodes of a scene dataset; all rows of a batch play in one layout.

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
        cameras: Which of ``head``, ``arm`` and ``third_person``; None for the class's `cameras`.
        camera_size_px: Width and height of their pictures; ManiSkill's `sensor_configs` can say
            otherwise for each of them, and knows more settings.
        camera_hfov_rad: Angle that their pictures span.
        invisible_arm: The arm is there and collides, but these cameras do not see it (S F.3); the
            human-render camera does. (In GPU simulation, that one does not see it either.)
        proprioception: False leaves out what the robot feels of itself (S F.1), so that the
            observation is what is to be done, and the images.
        target_frame: ``base``: a skill's target is the vector from the end-effector to it, along
            the base's axes, as actions of ``ee`` move the hand (Navigate: the point in the base
            frame); ``ee``: the target in the end-effector's frame, as in Habitat. Tasks have the
            base frame only.
        handle_position: True tells where the handle of the door or drawer is, along the base's
            axes; for environments that are about one.
        sensor_noise: None, or how far the sensors are off: a `SensorNoise` or a dict of its
            attributes (which can be recorded as JSON). It is drawn from the episode's seed.
        action_delay_steps: Actions are carried out so many steps later (S F.5); until the first
            one is due, the robot stands still and keeps what it holds.
        render_backend: ``auto``, ``none``, ``cpu`` or ``gpu``; `auto` renders only when needed.
        num_envs: Rows of the batch; more than one needs GPU simulation.
        kwargs: ManiSkill's own arguments (obs_mode, reward_mode, control_mode, ...).
    """

    SUPPORTED_ROBOTS: ClassVar[list[str]] = ["hab_fetch"]  # type: ignore[assignment]
    SUPPORTED_REWARD_MODES = ("dense", "normalized_dense", "sparse", "none")
    name: ClassVar[str]
    needs: ClassVar[Needs]
    horizon_steps: ClassVar[int]
    control_modes: ClassVar[tuple[str, ...]]
    reward_bound: ClassVar[float]
    _delay: ActionDelay | None
    _spec: EnvSpec | None = None

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
        cameras: Iterable[str] | None = None,
        camera_size_px: int = CAMERA_SIZE_PX,
        camera_hfov_rad: float = CAMERA_HFOV_RAD,
        invisible_arm: bool = False,
        proprioception: bool = True,
        target_frame: TargetFrame = "base",
        handle_position: bool = False,
        sensor_noise: SensorNoise | Mapping[str, float] | None = None,
        action_delay_steps: int = 0,
        render_backend: str = "auto",
        num_envs: int = 1,
        **kwargs: Any,
    ) -> None:
        check_inherited(self.name, inspect.signature(HabEnv.__init__).parameters, kwargs)
        self._set_entries(proprioception, target_frame, handle_position)
        self._set_sensors(cameras, camera_size_px, camera_hfov_rad, sensor_noise)
        self._hides_arm = flag("invisible_arm", invisible_arm)
        self._delay_steps = checked_steps(action_delay_steps)
        kwargs["render_backend"] = self._set_backend(render_backend, num_envs, kwargs)
        kwargs["control_mode"] = self._known_mode(kwargs.get("control_mode"))
        where: dict[str, Any] = {"scene_dataset": scene_dataset, "objects": objects, "scene": scene}
        which: dict[str, Any] = {"split": split, "file": episodes, "seed": episode_seed}
        request = EpisodeRequest(env_id=self.default_id(), novel=novel, **where, **which)
        source = open_source(request)
        self._world = World(self.needs, source, num_episodes, num_envs, prefetch=prefetch)
        super().__init__(num_envs=num_envs, **{"robot_uids": "hab_fetch", **kwargs})

    @classmethod
    def _known_mode(cls, control_mode: str | None) -> str:
        """Returns the control mode, the skill's first one for None; refuses any other."""
        modes = cls.control_modes
        if control_mode is not None and control_mode not in modes:
            raise UnknownNameError(f"control_mode of {cls.name}", control_mode, modes)
        return control_mode or modes[0]

    # The rules -------------------------------------------------------------------------------

    @abstractmethod
    def judge(self, snapshot: Snapshot, measures: Measures) -> Verdict:
        """Returns what the rules say of this moment; changes nothing."""

    @abstractmethod
    def masked_gripper(self, gripper: Rows, measures: Measures) -> Rows:
        """Returns the gripper entries (N,) that are carried out."""

    def begin_rows(self, rows: Tensor) -> None:
        """Runs after the episodes in `rows` (R,) have started."""

    def before_action(self) -> None:
        """Runs before an action is carried out."""

    def after_action(self) -> None:
        """Runs once after it, with the new snapshot and measures."""

    @classmethod
    def default_id(cls) -> str:
        """Returns the registered id of this class."""
        return f"{cls.__name__.removesuffix('Env')}-v1"

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """Gymnasium's spec, by whose id anybody can make the environment, without an import."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        package = type(self).__module__.partition(".")[0]
        if spec is not None and package == PACKAGE and ":" not in spec.id:
            spec = replace(spec, id=f"{PACKAGE}:{spec.id}")
        self._spec = spec

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
        return sim_config()

    def reset(
        self, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts episodes.

        ``info["reconfigure"]`` tells whether the state has other entries than before: other objects
        or another layout. A recorded ``episode_seed`` starts the same episode, whether a seed was
        given or not.

        Args:
            seed: Chooses the episodes; the same seed gives the same ones.
            options: ManiSkill's own, and ``episode``: an `Episode` or its index in the set, or a
                list with one for each row.

        Raises:
            OptionError: A seed or an option that is none.
            EpisodeError: An episode that there is not, or that does not fit into its layout.
        """
        options = entries("options", options)
        rows = options.get("env_idx")
        count = self.num_envs
        rows = list(range(count)) if rows is None else row_numbers("env_idx", rows, count)
        seeds("seed", seed, len(rows))
        rebuild = self._world.choose(rows, seed, options.pop("episode", None))
        if rebuild:
            options["reconfigure"] = True
        # Nothing draws from Gymnasium's generator, but its checker wants it seeded.
        gym.Env.reset(self, seed=None if seed is None else int(np.ravel(seed)[0]))
        before = self._world.shown
        obs, info = super().reset(seed=seed, options=options)
        if seed is None:
            self._episode_seed[rows] = [self._world.seeds[row] for row in rows]
        # Recorders look here whether states have other entries than before.
        info["reconfigure"] = info["reconfigure"] or self._world.shown is not before
        return obs, info

    def _load_scene(self, options: dict[str, Any]) -> None:
        self._world.build(self.scene, self.agent, lit=self._is_lit)
        self._start_observing()
        steps = self._delay_steps
        self._delay = ActionDelay(steps, self.agent.controller) if steps else None

    def _clear_sim_state(self) -> None:
        # On the CPU the episode sets all velocities itself, and frozen bodies have none.
        if self.gpu_sim_enabled:
            super()._clear_sim_state()

    def _initialize_episode(self, env_idx: Tensor, options: dict[str, Any]) -> None:
        self._world.apply(env_idx)
        if self._delay is not None:
            self._delay.begin(env_idx)
        if self._noise is not None:
            self._noise.begin(env_idx, [episode.seed for episode in self.episode])
        self.begin_rows(env_idx)
        self.__dict__.pop("segmentation_id_map", None)  # made anew: other bodies may be shown

    # Stepping --------------------------------------------------------------------------------

    def _step_action(self, action: np.ndarray | Tensor | None) -> Tensor | None:
        """Carries out one action; reads the simulator once; advances the tracker once."""
        if action is not None:
            action = self._batched(action)
            due = action if self._delay is None else self._delay.exchange(action, self._holding())
            self.agent.controller.set_action(due)
            if self.gpu_sim_enabled:
                px: Any = self.scene.px
                px.gpu_apply_articulation_target_position()
                px.gpu_apply_articulation_target_velocity()
        self.before_action()
        gripper = self.agent.controller.gripper
        gripper = gripper if self.gpu_sim_enabled else gripper.numpy()
        gripper = self.masked_gripper(gripper, self.measures)
        self._world.step(gripper, self._sim_steps_per_control)
        self.after_action()
        if self._noise is not None:
            self._noise.advance()
        return action

    def _holding(self) -> Tensor:
        """Returns whether anything is in each hand, (N,)."""
        snapshot = self._world.snapshot
        holding = (snapshot.held >= 0) | (snapshot.held_handle >= 0)
        return torch.as_tensor(holding, device=self.device)

    def _batched(self, action: np.ndarray | Tensor) -> Tensor:
        try:
            tensor = torch.as_tensor(action, dtype=torch.float32, device=self.device)
        except (TypeError, ValueError, RuntimeError) as error:
            raise ActionError(f"Action {action!r} is not an array of numbers ({error}).") from error
        return tensor[None] if tensor.dim() == 1 and self.num_envs == 1 else tensor

    def evaluate(self) -> dict[str, Any]:
        """Success, failure, measures and reward terms of the present moment; changes nothing."""
        verdict = self.judge(self._world.snapshot, self.measures)
        fail = reduce(or_, verdict.failures.values(), verdict.success & False)
        success = verdict.success & ~fail
        terms = verdict.reward_terms({"success": success, **verdict.failures})
        told = to_info(
            {
                "whole": {"success": success, "fail": fail, "reward": total(terms)},
                "failures": verdict.failures,
                "measures": verdict.measures(success),
                "reward_terms": terms,
                **verdict.extra,
            }
        )
        told["reward_terms"] = verdict.unpaid | told["reward_terms"]
        return {**told.pop("whole"), **told}

    def compute_dense_reward(self, obs: Any, action: Tensor, info: dict[str, Any]) -> Tensor:
        """Returns the sum of the reward terms, (N,)."""
        return info["reward"]

    def compute_normalized_dense_reward(
        self, obs: Any, action: Tensor, info: dict[str, Any]
    ) -> Tensor:
        """Returns the dense reward divided by its bound, never above 1, (N,)."""
        return (info["reward"] / self.reward_bound).clamp(max=1.0)

    # State -----------------------------------------------------------------------------------

    def get_state_dict(self) -> dict[str, Any]:
        """Returns the simulator's state and the episode's, enough to go on from here."""
        simulator: Any = super().get_state_dict()
        options = {name: option.get_state() for name, option in self._stateful.items()}
        return with_columns({**simulator, "hab": {**self._world.get_state(), **options}})

    @property
    def _stateful(self) -> dict[str, ActionDelay | NoiseSource]:
        """The options that are on and have a state of their own."""
        options = {"delay": self._delay, "noise": self._noise}
        return {name: option for name, option in options.items() if option is not None}

    def set_state_dict(self, state: dict[str, Any], env_idx: Tensor | None = None) -> None:
        """Restores what `get_state_dict` returned.

        Raises:
            EpisodeError: The state is of other furniture or objects than those of this episode.
        """
        rows = torch.arange(self.num_envs, device=self.device) if env_idx is None else env_idx
        simulator = {key: value for key, value in state.items() if key != "hab"}
        self._world.refuse_other_bodies(simulator)
        self._world.thaw()
        super().set_state_dict(simulator, env_idx)  # pyright: ignore[reportArgumentType]  # None is its default
        self._world.set_state(state["hab"], rows)
        for name, option in self._stateful.items():
            kept = shaped_like(state["hab"][name], option.get_state(), len(rows), self.device)
            option.set_state(kept, rows)
