"""Control modes of planners: joint targets or joint states, and what the base can do."""

from __future__ import annotations

from collections.abc import Mapping

from hab_tasks.envs import ENVS

CONTROLLERS = {"real": "joint_target", "perfect": "joint_state"}
"""Option ``controller``: targets of the real drives, or joint states that are set (S App. D)."""


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
