"""Interface to the environments and episodes of `hab_tasks`.

What loads the simulator is imported inside the functions: a run's agent may be in a process
without it, and tests of the evaluator play an environment of their own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, get_args

import gymnasium

import hab_tasks
from hab_eval.records.config import EvalConfig, robot_asked
from hab_tasks.agent import AgentSetup, AgentSpaces, AgentSpec, Looks
from hab_tasks.captions import LEGEND
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.registration import ENTRY_POINTS, imported_id, reference_of
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.robots.spec import robot_of

if TYPE_CHECKING:
    from hab_tasks.episodes import Episode, EpisodeSet
    from hab_tasks.io.executors import Executor
    from hab_tasks.robots.control import HabControllerConfig

SIMULATOR = "hab_tasks.engine.hab_env"
"""Module that loads the simulator."""

CountCallback = Callable[[int, int], None]
"""Called with (done, total) while episodes are generated."""


def agent_seed(seed: int) -> int:
    """Returns the seed that an agent gets instead of an episode's or a run's.

    An agent that knew the episode's seed could generate the episode and know every pose.
    """
    return int.from_bytes(hashlib.sha256(f"agent {seed}".encode()).digest()[:4], "big") >> 1


def check_env_id(env_id: str) -> None:
    """Imports the module of `env_id`; raises `HabError` unless it is an environment."""
    imported_id(env_id)


def worker_imports(config: EvalConfig) -> list[str]:
    """Returns the modules that every worker process of an evaluation needs."""
    return [SIMULATOR] if config.env.rpartition(":")[2] in ENTRY_POINTS else []


def setup_of(config: EvalConfig, device: str = "cpu") -> AgentSetup:
    """Returns the setup that the agent's factory receives.

    Args:
        config: The evaluation's configuration.
        device: Device of the agent's networks.
    """
    seed, robot = agent_seed(config.seed), robot_asked(config.env_options)
    return make_setup(config.env, seed, config.options, device, robot)


def make_setup(
    env_id: str, seed: int, options: Mapping[str, str], device: str, robot: str | None = None
) -> AgentSetup:
    """Returns a setup with spaces; its `seed` is the agent's, see `agent_seed`."""

    def spaces_of(env_id: str, spec: AgentSpec) -> AgentSpaces:
        from hab_tasks.agent_spaces import agent_spaces  # loads the simulator, if asked for

        return agent_spaces(env_id, spec, robot)

    return AgentSetup(
        env_id=env_id, seed=seed, options=options, device=device, robot=robot, spaces_of=spaces_of
    )


def load_episode_set(
    config: EvalConfig, progress: CountCallback | None, workers: int | Executor
) -> EpisodeSet:
    """Returns the episode set of `config`; `workers`, or an executor, generate missing ones."""
    return hab_tasks.load_episodes(request_of(config), config.episodes, progress, workers)


def request_of(config: EvalConfig) -> hab_tasks.EpisodeRequest:
    """Returns what episodes a configuration asks for."""
    return hab_tasks.EpisodeRequest(
        env_id=config.env,
        scene_dataset=config.scene_dataset,
        objects=config.objects,
        split=config.split,
        seed=config.seed,
        novel=config.novel,
        robot=robot_asked(config.env_options) or DEFAULT_ROBOT.uid,
        clutter=env_arguments(config.env_options).get("perturbation", {}).get("clutter", 0),
    )


def env_arguments(options: Mapping[str, str]) -> dict[str, Any]:
    """Returns the environment's arguments of options such as ``perturbation.clutter=5``.

    Raises:
        UnknownNameError: An unknown option.
        OptionError: A value that is not a number, or out of range.
    """
    if not options:
        return {}
    from hab_tasks.engine.noise import SensorNoise
    from hab_tasks.engine.perturbation import Perturbation

    groups = {"sensor_noise": SensorNoise(), "perturbation": Perturbation()}
    usual: dict[str, float | str] = {"action_delay_steps": 0, "robot": "", "grasp": ""}
    for group, values in groups.items():
        usual |= {f"{group}.{name}": value for name, value in asdict(values).items()}
    found: dict[str, Any] = {}
    for name, text in options.items():
        if name not in usual:
            raise UnknownNameError("--env-option", name, usual)
        try:
            value = type(usual[name])(text)
        except ValueError as error:
            raise OptionError.of_value(f"--env-option {name}", text, "a number") from error
        group, _, entry = name.rpartition(".")
        (found.setdefault(group, {}) if group else found)[entry] = value
    asked = robot_asked(options)
    if asked is not None:
        found = {k: v for k, v in found.items() if k not in ("robot", "grasp")}
        found["robot_uids"] = asked
    for group in groups.keys() & found.keys():
        type(groups[group]).of(found[group])
    return found


def make_env(
    config: EvalConfig, spec: AgentSpec, *, split: str | None, render: bool, num_episodes: int = 1
) -> gymnasium.Env[Any, Any]:
    """Creates the environment for an agent's spec, with `num_episodes` episodes by index.

    Creation shows one of them: of more than the run has, it might have to be generated.
    """
    if spec.looks not in get_args(Looks):
        raise UnknownNameError("looks of the agent", spec.looks, get_args(Looks))
    env = gymnasium.make(
        reference_of(imported_id(config.env)),
        num_envs=1,
        scene_dataset=config.scene_dataset,
        objects=config.objects,
        split=split,
        num_episodes=num_episodes,
        episode_seed=config.seed,
        novel=config.novel,
        obs_mode=spec.obs_mode,
        control_mode=spec.control_mode,
        target_frame=spec.target_frame,
        handle_position=spec.handle_position,
        targets=spec.targets,
        cameras=spec.cameras,
        camera_size_px=spec.camera_size_px,
        camera_hfov_rad=spec.camera_hfov_rad,
        invisible_arm=spec.invisible_arm,
        proprioception=spec.proprioception,
        instructions=config.instructions,
        skill_config=config.skill_config,
        **env_arguments(config.env_options),
        reward_mode="dense",
        render_mode="rgb_array" if render else None,
        render_backend="auto",
    )
    if spec.looks == "on demand":
        base: Any = env.unwrapped
        base.leave_out_images()
    return env


def instruction_of(env_id: str, episode: Episode) -> str:
    """Returns the instruction of an episode and the legend of its markers."""
    return f"{hab_tasks.ENVS[env_id].env.instruct(episode)} ({LEGEND})"


def continuous_control(env_id: str) -> str:
    """Returns an environment's first control mode with continuous actions."""
    modes = hab_tasks.ENVS[env_id].env.control_modes
    return next(mode for mode in modes if not mode.endswith("_discrete"))


def action_size(env_id: str, control_mode: str, robot: str | None = None) -> int:
    """Returns the number of action entries of a control mode; `robot` as in `AgentSetup`."""
    return _control(env_id, control_mode, robot).size


def gripper_entry(env_id: str, control_mode: str, robot: str | None = None) -> int | None:
    """Returns the index of the gripper's action entry; None for modes without arm."""
    return _control(env_id, control_mode, robot).arm_size or None


def _control(env_id: str, control_mode: str, robot: str | None) -> HabControllerConfig:
    from hab_tasks.robots.control import control_configs  # loads the simulator

    own = hab_tasks.ENVS[env_id].env.robot if robot is None else robot_of(robot)
    return control_configs(own)[control_mode]
