"""Control modes of the planning agents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from hab_spa.motion.robot import SpaConfig
from hab_spa.planning.arm_plan import PLANNERS
from hab_tasks.agent import AgentSetup, check_options
from hab_tasks.envs import ENVS
from hab_tasks.errors import UnknownNameError
from hab_tasks.registration import imported_id

T = TypeVar("T")

CONTROLLERS = {"real": "joint_target", "perfect": "joint_state"}
"""Option ``controller``: joint targets of the simulated drives, or joint states (S App. D)."""


def skill_asked(setup: AgentSetup, agent: str, skills: Mapping[str, T]) -> tuple[str, T]:
    """Returns the environment id of a single-skill agent, and its entry in `skills`.

    Raises:
        UnknownNameError: The environment is not a supported skill, or an option is unknown.
    """
    check_options(setup, {"controller": CONTROLLERS, "planner": PLANNERS})
    env_id = imported_id(setup.env_id)
    if env_id not in skills:
        raise UnknownNameError(f"environment of {agent}", env_id, skills)
    return env_id, skills[env_id]


def planned(setup: AgentSetup, config: SpaConfig | None = None) -> SpaConfig:
    """Returns parameters, the paper's by default, with the planner of the option ``planner``."""
    return (config or SpaConfig()).planned_by(
        setup.options.get("planner", "ompl"), ENVS[imported_id(setup.env_id)].env.robot
    )


def control_mode(env_id: str, options: Mapping[str, str]) -> str:
    """Returns the control mode for an environment and the agent's options.

    Args:
        env_id: The environment.
        options: ``controller``, and ``navigation`` for tasks.
    """
    modes = ENVS[env_id].env.control_modes
    arm = CONTROLLERS[options.get("controller", "real")]
    if options.get("navigation") == "perfect":
        return f"{arm}_pose"
    return next((mode for mode in (arm, f"{arm}_base") if mode in modes), "base")
