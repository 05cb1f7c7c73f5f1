"""Validation of ManiSkill's options before the environment is built."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.envs.utils.observations import parse_obs_mode_to_struct
from mani_skill.envs.utils.system.backend import CPU_SIM_BACKENDS

from hab_tasks.errors import OptionError, UnknownNameError

ADVICE = (
    "Several rows run on CPU cores: gymnasium.make_vec('hab_tasks:HabPick-v1', num_envs=N), about "
    "1,700 steps/s with 16 rows on two cores (docs/speed.md)."
)
OBS_MODES = "'state', 'state_dict', 'none', or textures joined by '+', e.g. 'rgb+depth'"
RENDER_MODES = ("human", "rgb_array", "sensors", "all")
INHERITED = tuple(inspect.signature(BaseEnv.__init__).parameters)[1:]


def check_inherited(env: str, own: Mapping[str, Any], options: Mapping[str, Any]) -> None:
    """Rejects options unknown to ManiSkill, and values on which it would fail later.

    Args:
        env: Name of the environment, for messages.
        own: The parameters of the environment itself, by name.
        options: The remaining options.

    Raises:
        UnknownNameError: Unknown option, reward mode or render mode.
        OptionError: Invalid observation mode, more than one row, or simulation on a GPU.
    """
    valid = [name for name in (*own, *INHERITED) if name not in ("self", "kwargs")]
    for name in options:
        if name not in INHERITED:
            raise UnknownNameError(f"option of {env}", name, valid)
    for name, modes in (
        ("reward_mode", BaseEnv.SUPPORTED_REWARD_MODES),
        ("render_mode", RENDER_MODES),
    ):
        if options.get(name) not in (None, *modes):
            raise UnknownNameError(name, options[name], modes)
    _check_rows(options.get("num_envs", 1), options.get("sim_backend"))
    _check_obs_mode(options.get("obs_mode"))


def _check_rows(num_envs: Any, sim_backend: str | None) -> None:
    """Rejects batches, and simulation on a GPU."""
    if num_envs != 1:
        raise OptionError.of_value("num_envs", num_envs, f"1. {ADVICE}")
    if (sim_backend or "auto").partition(":")[0] not in (*CPU_SIM_BACKENDS, "auto"):
        raise OptionError.of_value("sim_backend", sim_backend, f"'physx_cpu' or 'auto'. {ADVICE}")


def _check_obs_mode(obs_mode: Any) -> None:
    if obs_mode in (None, *BaseEnv.SUPPORTED_OBS_MODES):
        return
    try:
        parse_obs_mode_to_struct(obs_mode)
    except (AssertionError, AttributeError, TypeError) as error:
        raise OptionError.of_value("obs_mode", obs_mode, OBS_MODES) from error
