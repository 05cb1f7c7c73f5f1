"""Control modes of planners: joint targets or joint states, and what the base can do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from hab_tasks.agent import AgentSetup, check_options
from hab_tasks.envs import ENVS
from hab_tasks.errors import UnknownNameError

T = TypeVar("T")

CONTROLLERS = {"real": "joint_target", "perfect": "joint_state"}
"""Option ``controller``: targets of the real drives, or joint states that are set (S App. D)."""


def skill_asked(setup: AgentSetup, agent: str, skills: Mapping[str, T]) -> tuple[str, T]:
    """Returns the environment id that an agent of one skill is asked for, and what it does there.

    Raises:
        UnknownNameError: The environment is no skill that this agent can do, or an option is
            unknown.
    """
    check_options(setup, {"controller": CONTROLLERS})
    env_id = setup.env_id.rsplit(":", 1)[-1]
    if env_id not in skills:
        raise UnknownNameError(f"environment of {agent}", env_id, skills)
    return env_id, skills[env_id]


def control_mode(env_id: str, options: Mapping[str, str]) -> str:
    """Returns the control mode of an environment that an agent's options ask for.

    Args:
        env_id: The environment.
        options: ``controller``, and ``navigation`` where the base is driven.
    """
    modes = ENVS[env_id].env.control_modes
    arm = CONTROLLERS[options.get("controller", "real")]
    if options.get("navigation") == "teleport":
        return f"{arm}_pose"
    return next((mode for mode in (arm, f"{arm}_base") if mode in modes), "base")
