"""All that an evaluation asks of `hab_tasks.envs` and `hab_tasks.episodes`, in one place.

Both are imported inside the functions: importing them starts the simulator, which help texts,
tables and tests of the evaluator do without.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from hab_eval.config import EvalConfig
from hab_tasks.agent import AgentSetup, AgentSpaces, AgentSpec, Looks
from hab_tasks.errors import UnknownNameError

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode, EpisodeSet

CountCallback = Callable[[int, int], None]
"""Called with (done, total) while episodes are generated."""


def env_ids() -> list[str]:
    """Returns the ids of all environments."""
    from hab_tasks.envs import ENVS

    return list(ENVS)


def check_env_id(env_id: str) -> None:
    """Raises `UnknownNameError` unless `env_id` is an environment."""
    valid = env_ids()
    if env_id not in valid:
        raise UnknownNameError("environment", env_id, valid)


def setup_of(config: EvalConfig, device: str = "cpu") -> AgentSetup:
    """Returns what the factory of the agent that `config` names is told.

    Args:
        config: The evaluation.
        device: Where the agent's networks are to run.
    """

    def spaces_of(env_id: str, spec: AgentSpec) -> AgentSpaces:
        from hab_tasks.agent_spaces import agent_spaces

        return agent_spaces(env_id, spec)

    return AgentSetup(
        env_id=config.env,
        seed=config.seed,
        options=config.options,
        device=device,
        spaces_of=spaces_of,
    )


def load_episode_set(
    config: EvalConfig, progress: CountCallback | None, workers: int
) -> EpisodeSet:
    """Returns the fixed list of episodes that `config` names; `workers` make missing ones."""
    from hab_tasks.episodes import EpisodeRequest, load_episodes

    request = EpisodeRequest(
        env_id=config.env,
        scene_dataset=config.scene_dataset,
        objects=config.objects,
        split=config.split,
        seed=config.seed,
        novel=config.novel,
    )
    return load_episodes(request, config.episodes, progress, workers)


def make_env(
    config: EvalConfig, spec: AgentSpec, *, split: str, render: bool, num_episodes: int = 50
) -> gym.Env[Any, Any]:
    """Makes the environment that an agent's spec asks for, with so many episodes by index."""
    import gymnasium

    if spec.looks not in get_args(Looks):
        raise UnknownNameError("looks of the agent", spec.looks, get_args(Looks))
    env = gymnasium.make(
        f"hab_tasks:{config.env}",
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
        reward_mode="dense",
        render_mode="rgb_array" if render else None,
        render_backend="auto",
    )
    if spec.looks == "on demand":
        base: Any = env.unwrapped
        base.leave_out_images()
    return env


def instruction_of(env_id: str, episode: Episode) -> str:
    """Returns what is to be done in an episode, in a sentence, and what the marks mean."""
    from hab_tasks.envs import ENVS
    from hab_tasks.instructions import instruction
    from hab_tasks.skills.marks import LEGEND

    return f"{instruction(ENVS[env_id].env, episode)} ({LEGEND})"


def continuous_control(env_id: str) -> str:
    """Returns an environment's first control mode whose actions are numbers, not cells."""
    from hab_tasks.envs import ENVS

    modes = ENVS[env_id].env.control_modes
    return next(mode for mode in modes if not mode.endswith("_discrete"))


def action_size(control_mode: str) -> int:
    """Returns the number of action entries of a control mode."""
    from hab_tasks.robots.control import control_configs

    return control_configs()[control_mode].size


def gripper_entry(control_mode: str) -> int | None:
    """Returns which action entry opens and closes the hand; None where the arm is not moved."""
    from hab_tasks.robots.control import control_configs
    from hab_tasks.robots.control_modes import ARM_SIZE

    return ARM_SIZE[control_configs()[control_mode].arm] or None


def short_name(dataset: str) -> str:
    """Returns a dataset's name without the folders above it, which differ between machines."""
    return Path(dataset).name or dataset
