"""Teachers of distillation: a trained policy, or a scripted expert."""

from __future__ import annotations

from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any, Protocol

import hab_experts
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from hab_ppo.agent import WEIGHTS, LoadedPolicy, load_policy, weights_file
from hab_ppo.errors import PolicyFileError, RecipeError
from hab_ppo.network import Policy
from hab_ppo.recipe import EnvConfig
from hab_tasks.agent_spaces import agent_setup
from hab_tasks.envs import ENVS
from hab_tasks.registration import imported_id


class Teacher(Protocol):
    """Tells what to do in the states of a vector environment."""

    def labels(self, obs: Any, starts: Tensor) -> NDArray[Any]:
        """Returns the best actions, as the environment takes them, (N, ...).

        Args:
            obs: The environment's observation.
            starts: (N,) bool, true where an episode starts.
        """
        ...


class PolicyTeacher:
    """A policy, with its most likely actions."""

    def __init__(self, policy: Policy, rows: int) -> None:
        """Teaches in an environment of `rows` with a policy on the CPU."""
        self._policy, self._memory = policy, policy.no_memory(rows)

    def labels(self, obs: Any, starts: Tensor) -> NDArray[Any]:
        """See `Teacher`."""
        acted = self._policy.choose(self._policy.layout.read(obs), self._memory, starts)
        self._memory = acted.memory
        return self._policy.head.to_env(acted.actions)


class Expert:
    """A scripted expert (`hab_experts`), which knows more than can be observed."""

    def __init__(self, env: Any, name: str, repeat: int = 1) -> None:
        """Teaches in a vector environment, which repeats actions."""
        self._env, self._function = env, f"{hab_experts.__name__}:{name}"
        self._named = {} if repeat == 1 else {"repeat": repeat}

    def labels(self, obs: Any, starts: Tensor) -> NDArray[Any]:
        """See `Teacher`."""
        return np.concatenate(self._env.call("ask", self._function, **self._named))


def check_expert(name: str, env: EnvConfig) -> None:
    """Rejects an expert that does not master a skill.

    Raises:
        RecipeError: There is no such expert, or one that does not know of repeated actions.
    """
    skill = ENVS[imported_id(env.reference)].env.name
    if skill not in hab_experts.SKILLS.get(name, ()):
        raise RecipeError(f"{env.env} has no expert {name}.")
    known = signature(getattr(hab_experts, name)).parameters
    if env.action_repeat > 1 and "repeat" not in known:
        raise RecipeError(f"The expert {name} needs action_repeat 1, not {env.action_repeat}.")


def known_weights(name: str, option: str) -> Path:
    """Returns the file of weights of a policy that ships, of a run, or itself.

    Args:
        name: The policy's name or a path.
        option: The option of ``hab-ppo train`` for them.

    Raises:
        PolicyFileError: There are none.
    """
    path = weights_file(Path(name))
    shipped = WEIGHTS / f"{name}.safetensors"
    if path.is_file():
        return path
    if shipped.is_file():
        return shipped
    raise PolicyFileError(
        f"There are no weights {name}: train them, and give the run's folder as {option} DIR."
    )


def load_teacher(path: Path, env: EnvConfig) -> LoadedPolicy:
    """Returns the policy of a file of weights.

    Args:
        path: The file.
        env: The student's environment.

    Raises:
        PolicyFileError: The file cannot be used.
        RecipeError: The teacher acts in another environment.
    """
    teacher = load_policy(agent_setup(env.reference), path)
    recipe = teacher.recipe
    if imported_id(recipe.env.reference) != imported_id(env.reference):
        raise RecipeError(f"The teacher {path} acts in {recipe.env.env}, not {env.env}.")
    for name in ("control_mode", "target_frame"):
        if getattr(recipe.env, name) != getattr(env, name):
            raise RecipeError(
                f"The teacher {path} has {name} {getattr(recipe.env, name)!r}, not "
                f"{getattr(env, name)!r}."
            )
    return teacher


def classroom(env: EnvConfig, teacher: LoadedPolicy) -> EnvConfig:
    """Returns the student's environment, in which the teacher sees all that it observes.

    The student's own observation stays as it is: a teacher that observes a handle can teach one
    that has to find it in images.

    Raises:
        RecipeError: The teacher has images that the student does not have.
    """
    own = teacher.recipe.env
    if not own.obs_mode.startswith("state") and own.obs_mode != env.obs_mode:
        raise RecipeError(
            f"The teacher {own.env} observes {own.obs_mode}, the student {env.obs_mode}."
        )
    return replace(env, handle_position=env.handle_position or own.handle_position)
