"""Adapter of `HabVectorEnv` to Stable-Baselines3, which is not a dependency of this package."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from hab_tasks.errors import OptionError
from hab_tasks.vector.vector_env import HabVectorEnv


class SB3VecEnv(VecEnv):
    """A `HabVectorEnv` with Stable-Baselines3's interface.

    Args:
        env: Made with ``autoreset_mode="same_step"``, as Stable-Baselines3 expects.

    Raises:
        OptionError: Another autoreset mode.
    """

    def __init__(self, env: HabVectorEnv) -> None:
        mode = env.metadata["autoreset_mode"]
        if mode is not AutoresetMode.SAME_STEP:
            raise OptionError.of_value(
                "autoreset_mode", mode.value, f"{AutoresetMode.SAME_STEP.value!r} here"
            )
        self.venv = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.render_mode = env.render_mode
        self._actions: Any = None

    def reset(self) -> Any:
        """Starts episodes, with the seeds of `seed` if it was called before."""
        seeds = self._seeds if any(one is not None for one in self._seeds) else None
        obs, info = self.venv.reset(seed=seeds)
        self.reset_infos = [_row_of(info, row) for row in range(self.num_envs)]
        self._reset_seeds()
        return obs

    def step_async(self, actions: Any) -> None:
        """Stores the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Executes the stored actions."""
        obs, reward, terminated, truncated, info = self.venv.step(self._actions)
        last = info.pop("final_obs", None)
        final = info.pop("final_info", {})
        infos = []
        for row in range(self.num_envs):
            over = bool(terminated[row] or truncated[row])
            one = _row_of(final if over else info, row)
            if last is not None and over:
                one["terminal_observation"] = last[row]
                one["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
            infos.append(one)
        return obs, reward, terminated | truncated, infos

    def close(self) -> None:
        """Ends the workers."""
        self.venv.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Returns an attribute of the environments of the rows `indices`; of all for None."""
        return self._chosen(self.venv.get_attr(attr_name), indices)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not available: rows of one vector environment share their options."""
        raise NotImplementedError("attributes of rows cannot be set; make another environment")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Calls a method of every row's environment; returns the results of `indices`."""
        results = self.venv.call(method_name, *method_args, **method_kwargs)
        return self._chosen(results, indices)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Returns False: rows have no wrappers."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Returns a frame of each row; requires a `render_mode`."""
        return list(self.venv.render() or ())

    def _chosen(self, values: Sequence[Any], indices: Any) -> list[Any]:
        return [values[row] for row in self._get_indices(indices)]


def _row_of(info: dict[str, Any], row: int) -> dict[str, Any]:
    """Returns one row's `info`."""
    return {
        name: _row_of(value, row) if isinstance(value, dict) else value[row]
        for name, value in info.items()
        if not name.startswith("_")
    }
