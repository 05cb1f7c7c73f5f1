"""Base environment; defines the order of step and reset."""

from __future__ import annotations

import inspect
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import gymnasium as gym
import numpy as np
import torch
from gymnasium.envs.registration import EnvSpec
from mani_skill.utils.structs.types import SimConfig
from torch import Tensor

from hab_tasks.agent import TargetFrame, Targets
from hab_tasks.arrays import Floats, of_row, shared_tensor, to_tensor
from hab_tasks.constants import CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.engine.goals import Requirements
from hab_tasks.engine.inherited_options import check_inherited
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.noise import SensorNoise
from hab_tasks.engine.observing_env import ObservingEnv
from hab_tasks.engine.perturbation import Perturbation
from hab_tasks.engine.recorded_state import from_flat, shaped_like, with_columns, words_of
from hab_tasks.engine.rows import Rows
from hab_tasks.engine.rules import Rules
from hab_tasks.episodes.schema import Episode, EpisodeRequest
from hab_tasks.episodes.source import open_source
from hab_tasks.errors import ActionError, EpisodeError, UnknownNameError
from hab_tasks.instructions import FIXED, Words
from hab_tasks.option_values import entries, row_numbers, seeds
from hab_tasks.registration import reference_of, registered_id
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.robots.control_modes import nearest_mode
from hab_tasks.robots.spec import RobotSpec, requested_robot, robot_reference
from hab_tasks.world.scenes.physics import sim_config


class HabEnv(ObservingEnv):
    """Runs episodes of a scene dataset; observations and results have a batch dimension of one.

    Args:
        scene_dataset: ``apartment`` or the path of a ReplicaCAD folder.
        objects: Path of a YCB folder; None for the embedded objects.
        split: ``train``, ``val`` or ``test``; None picks the least-seen split available.
        scene: Restrict episodes to this layout.
        episodes: An episode file instead of generated episodes.
        num_episodes: Number of episodes of the split to sample from.
        episode_seed: Seed of the generated episodes.
        novel: ``objects`` or ``receptacles`` held out for evaluation (S E.1).
        cameras: Any of ``head``, ``arm`` and ``third_person``; None for the class's `cameras`.
        camera_size_px: Image size; ManiSkill's `sensor_configs` overrides settings per camera.
        camera_hfov_rad: Horizontal field of view.
        invisible_arm: Hide the arm from these cameras while it still collides (S F.3).
        depth: ``m``: float32, 1 is 10 m or no return; ``mm``: ManiSkill's int16, 0 is no return.
        proprioception: False leaves proprioception out of the observation (S F.1).
        target_frame: ``base``: a skill's target is the vector from the end-effector to it along
            the axes of the base, as in ``ee`` actions (Navigate: the point in the base frame);
            ``ee``: the target in the end-effector's frame, as in Habitat. Tasks support ``base``
            only.
        handle_position: Adds the door's or drawer's handle, along the axes of the base.
        targets: ``language`` leaves out every position of an object, goal, handle or receptacle.
        instructions: ``fixed`` or ``varied`` (`hab_tasks.instructions`).
        skill_config: Overrides of reward weights and thresholds, e.g. ``{"weights.force": 0.01,
            "force_limit_n": 2500.0}``; in a task after the skill: ``pick.weights.force``.
        sensor_noise: A `SensorNoise`, or a dict of its attributes; seeded by the episode.
        action_delay_steps: Delay of actions in steps (S F.5); at first the robot stands still.
        perturbation: None, a `Perturbation`, or a dict of its attributes.
        robot: ``fetch``, ``panda_mobile`` or one of `register_robot`; as ManiSkill's robot_uids.
        grasp: ``snap`` or ``friction``; None for the robot's own.
        render_backend: ``auto``, ``none``, ``cpu``, ``gpu`` or ``rays``. `rays` computes depth,
            position and segmentation on the CPU along each pixel's ray, without a graphics driver;
            `auto` does so unless colour is observed. A `render_mode` needs a renderer in any case.
        kwargs: ManiSkill's own arguments (obs_mode, reward_mode, control_mode, ...).
    """

    SUPPORTED_ROBOTS = None  # type: ignore[assignment]  # those of `robots.spec`
    SUPPORTED_REWARD_MODES = ("dense", "normalized_dense", "sparse", "none")
    name: ClassVar[str]
    requirements: ClassVar[Requirements]
    horizon_steps: ClassVar[int]
    control_modes: ClassVar[tuple[str, ...]]
    reward_bound: ClassVar[float]
    robot: RobotSpec = DEFAULT_ROBOT
    score_names: ClassVar[tuple[str, ...]] = ()
    _unpaid: tuple[dict[str, Floats], dict[str, Tensor]] = ({}, {})
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
        cameras: Iterable[str] | None = None,
        camera_size_px: int = CAMERA_SIZE_PX,
        camera_hfov_rad: float = CAMERA_HFOV_RAD,
        invisible_arm: bool = False,
        depth: Literal["m", "mm"] = "m",
        proprioception: bool = True,
        target_frame: TargetFrame = "base",
        handle_position: bool = False,
        targets: Targets = "positions",
        instructions: str = "fixed",
        skill_config: Mapping[str, float] | None = None,
        sensor_noise: SensorNoise | Mapping[str, float] | None = None,
        action_delay_steps: int = 0,
        perturbation: Perturbation | Mapping[str, float] | None = None,
        robot: str | None = None,
        grasp: str | None = None,
        render_backend: str = "auto",
        **kwargs: Any,
    ) -> None:
        kwargs = self._known(kwargs, robot, grasp)
        self.configure(entries("skill_config", skill_config))
        self._set_told(proprioception, target_frame, handle_position, targets, instructions, depth)
        self._set_sensors(cameras, camera_size_px, camera_hfov_rad, invisible_arm)
        where: dict[str, Any] = {"scene_dataset": scene_dataset, "objects": objects, "scene": scene}
        of: Any = {"split": split, "file": episodes, "seed": episode_seed, "novel": novel}
        options = num_episodes, action_delay_steps, sensor_noise
        self.simulation = self._simulated(where | of, Perturbation.of(perturbation), *options)
        kwargs["render_backend"] = self._set_backend(render_backend, kwargs)
        super().__init__(**kwargs)  # builds the first scene

    def _known(
        self, options: dict[str, Any], robot: str | None, grasp: str | None
    ) -> dict[str, Any]:
        """Sets the robot; returns ManiSkill's options, checked, with a control mode."""
        self.robot = requested_robot(options.get("robot_uids"), robot, grasp, self.robot)
        options = {**options, "robot_uids": self.robot.uid}
        check_inherited(self.name, inspect.signature(HabEnv.__init__).parameters, options)
        return {**options, "control_mode": self.known_mode(options.get("control_mode"))}

    def _simulated(
        self, request: dict[str, Any], perturbation: Perturbation, *options: Any
    ) -> EpisodeSimulation:
        """Returns the simulation of requested episodes."""
        request |= {"env_id": registered_id(type(self)), "clutter": perturbation.clutter}
        source = open_source(EpisodeRequest(**request, robot=robot_reference(self.robot)))
        options = *options, perturbation
        simulation = EpisodeSimulation(self.robot, self.requirements, source, *options)
        Rows([simulation], self.rules_of)  # kept by the simulation, until a worker joins it
        return simulation

    @classmethod
    def known_mode(cls, control_mode: str | None) -> str:
        """Returns a valid control mode; the skill's first one for None.

        Raises:
            UnknownNameError: With the nearest of the valid modes.
        """
        modes = cls.control_modes
        if control_mode is not None and control_mode not in modes:
            near = nearest_mode(control_mode, modes)
            raise UnknownNameError(f"control_mode of {cls.name}", control_mode, modes, near)
        return control_mode or modes[0]

    # The rules -------------------------------------------------------------------------------

    @abstractmethod
    def rules_of(self, rows: Rows) -> Rules:
        """Returns the rules of this environment, as configured, for the episodes of `rows`."""

    @classmethod
    @abstractmethod
    def instruct(cls, episode: Episode, words: Words = FIXED) -> str:
        """Returns the instruction of an episode in words."""

    @classmethod
    def summary(cls) -> str:
        """Returns the summary of this environment: the first sentence of its docstring."""
        return " ".join((inspect.getdoc(cls) or "").partition("\n\n")[0].split())

    @property
    def instruction(self) -> list[str]:
        """Instruction of the episode in words, one; also in `info` of a reset."""
        return [self.instruct(self.simulation.episode, self.words)]

    @property
    def stage_instruction(self) -> list[str]:
        """Instruction of the current stage, one; a skill has a single stage."""
        return self.instruction

    @abstractmethod
    def configure(self, changes: Mapping[str, float]) -> None:
        """Overrides reward weights and thresholds by name."""

    @classmethod
    def default_id(cls) -> str:
        """Returns the registered id of this class."""
        return f"{cls.__name__.removesuffix('Env')}-v1"

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """Gymnasium's spec; its id includes the module, so no import is needed to make it."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.id == self.default_id():
            spec = replace(spec, id=reference_of(spec.id))
        self._spec = spec

    @property
    def episode(self) -> tuple[Episode]:
        """The current episode."""
        return (self.simulation.episode,)

    def draw_from(self, first: int) -> None:
        """Draws further episodes from the `first` of its `num_episodes`, which may still grow."""
        self.simulation.sampler.draw_from(first)

    @property
    def rows(self) -> Rows:
        """The rows that this environment belongs to: one, or those of a worker of `make_vec`."""
        return self.simulation.rows

    @property
    def here(self) -> slice:
        """Where this environment is among the rows."""
        return slice(self.simulation.row, self.simulation.row + 1)

    @property
    def rules(self) -> Rules:
        """The rules of the rows."""
        return self.rows.rules

    @property
    def measures(self) -> Measures:
        """The measures after the latest control step, a batch of one."""
        return of_row(self.rows.measures, self.simulation.row)

    def privileged(self) -> list[Any]:
        """Returns the true state, one (see `hab_tasks.privileged`)."""
        return [self.simulation.privileged()]

    # Building and resetting ------------------------------------------------------------------

    @property
    def _default_sim_config(self) -> SimConfig:
        return sim_config()

    def reset(
        self, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts episodes.

        ``info["instruction"]`` holds the instruction in words; ``info["reconfigure"]`` reports
        whether the entries of the state changed (other objects or another layout). A recorded
        ``episode_seed`` reproduces the episode, whether or not a seed was given.

        Args:
            seed: Determines the episode; the same seed gives the same episode.
            options: ManiSkill's options, and ``episode``: an `Episode`, its index in the set, or a
                list of one of these; `reset_to_env_states` keeps the current one by default.

        Raises:
            OptionError: Invalid seed or option.
            EpisodeError: Unknown episode, or an episode that does not match its layout.
        """
        options, simulation = entries("options", options), self.simulation
        if options.get("env_idx") is not None:
            options["env_idx"] = torch.tensor(row_numbers("env_idx", options["env_idx"], 1))
        seeds("seed", seed, 1)
        number = None if seed is None else int(np.ravel(seed)[0])
        # ManiSkill would set a state instead of starting the episode that the state is of.
        episode, restored = options.pop("episode", None), options.pop("reset_to_env_states", None)
        if isinstance(episode, list | tuple):
            if len(episode) != 1:
                raise EpisodeError(f"{len(episode)} episodes for 1 row; pass one per row.")
            (episode,) = episode
        if restored and seed is None and episode is None and simulation.shown is not None:
            episode = simulation.episode
        if simulation.choose(number, episode):
            options["reconfigure"] = True
        # Gymnasium's generator is unused, but Gymnasium's checker requires it to be seeded.
        gym.Env.reset(self, seed=number)
        before = simulation.shown
        obs, info = super().reset(seed=seed, options=options)
        if seed is None:
            # ManiSkill's recorder stores this; the seed that it drew would give another episode.
            self._episode_seed[:] = simulation.sampler.seed
        # Recorders read from this whether the entries of the state changed.
        info["reconfigure"] = info["reconfigure"] or simulation.shown is not before
        if restored:
            states = restored["env_states"]
            restore: Any = self.set_state_dict if isinstance(states, dict) else self.set_state
            restore(states)
            info |= self.get_info()
            obs = restored["obs"] if "obs" in restored else self.get_obs(info)
        info["instruction"] = self.instruction
        return obs, info

    def _load_scene(self, options: dict[str, Any]) -> None:
        self.simulation.build(self.scene, self.agent, lit=self._is_lit)
        self._start_observing()

    def _clear_sim_state(self) -> None:
        """Does nothing: the episode sets all velocities, and sleeping bodies have none."""

    def _initialize_episode(self, env_idx: Tensor, options: dict[str, Any]) -> None:
        self.simulation.apply()
        self._displace_cameras()
        self.rows.begin(self.simulation.row)
        self.__dict__.pop("segmentation_id_map", None)  # cached; the bodies may have changed

    # Stepping --------------------------------------------------------------------------------

    def _step_action(self, action: np.ndarray | Tensor | None) -> Tensor | None:
        """Executes one action; reads the simulator once; advances the tracker once."""
        entries = None
        if action is not None:
            action = self._batched(action)
            entries = self.agent.controller.check(action)
        self.rows.step({self.simulation.row: entries})
        return action

    def _batched(self, action: np.ndarray | Tensor) -> Tensor:
        try:
            tensor = torch.as_tensor(action, dtype=torch.float32, device=self.device)
        except (TypeError, ValueError, RuntimeError) as error:
            raise ActionError(f"Action {action!r} is not an array of numbers ({error}).") from error
        return tensor[None] if tensor.dim() == 1 else tensor

    def evaluate(self) -> dict[str, Any]:
        """Returns success, failures, measures and reward terms; has no side effects."""
        result, here = self.rows.rules.evaluate(), self.here
        info: dict[str, Any] = {
            "success": shared_tensor(result.success[here]),
            "fail": shared_tensor(result.fail[here]),
            # ManiSkill asks for the reward later; the rules are evaluated once.
            "reward": shared_tensor(result.reward[here]),
        }
        for group, values in result.groups.items():
            info[group] = {name: shared_tensor(value[here]) for name, value in values.items()}
        # The rules give the same zeros in every step, so they become tensors once.
        if self._unpaid[0] is not result.unpaid:
            self._unpaid = result.unpaid, {n: to_tensor(x[here]) for n, x in result.unpaid.items()}
        info["reward_terms"] = self._unpaid[1] | info["reward_terms"]
        return info

    def compute_dense_reward(self, obs: Any, action: Tensor, info: dict[str, Any]) -> Tensor:
        """Returns the sum of the reward terms, (N,)."""
        return info["reward"]

    def compute_normalized_dense_reward(
        self, obs: Any, action: Tensor, info: dict[str, Any]
    ) -> Tensor:
        """Returns the dense reward divided by its bound, at most 1, (N,)."""
        return (info["reward"] / self.reward_bound).clamp(max=1.0)

    # State -----------------------------------------------------------------------------------

    def get_state_dict(self) -> dict[str, Any]:
        """Returns the state of simulator and episode, sufficient to resume from.

        Nested tensors (N, C). `get_state` returns the same as one (N, D) float32; it has no names,
        and can only be restored in the episode that it is of.
        """
        found: Any = super().get_state_dict()
        # Sorted, as the simulation's order depends on the layouts that it has shown before.
        simulator = {kind: dict(sorted(entries.items())) for kind, entries in found.items()}
        state, shown = self.rows.get_state(self.simulation.row), self.simulation.shown
        state["hab"]["bodies"] = words_of([shown.checksum if shown else 0], 2)
        return with_columns({**simulator, **state})

    def set_state(self, state: Tensor, env_idx: Tensor | None = None) -> None:
        """Restores a flat state (1, D) of `get_state`.

        Raises:
            EpisodeError: The state is not of this episode's layout and objects.
        """
        self.set_state_dict(from_flat(state, self.get_state_dict()))

    def set_state_dict(self, state: dict[str, Any], env_idx: Tensor | None = None) -> None:
        """Restores a state of `get_state_dict`.

        Raises:
            EpisodeError: The state has other furniture or objects than this episode.
        """
        rows, row = self.rows, self.simulation.row
        present = rows.get_state(row)
        simulator = {key: value for key, value in state.items() if key not in present}
        # All checks come first, so that a bad state leaves the episode as it is.
        self.simulation.refuse_other_bodies(simulator)
        kept = shaped_like(state, present)
        # A sleeping body is kinematic, and takes no velocity.
        self.simulation.thaw()
        super().set_state_dict(simulator)
        rows.set_state(row, kept)
