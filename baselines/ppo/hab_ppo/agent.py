"""Trained policies as agents, for ``hab-eval run --agent hab_ppo:pick_blind``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from hab_ppo import checkpoint
from hab_ppo.actions import RowNoise
from hab_ppo.checkpoint import PolicyFileError
from hab_ppo.network import Policy, new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.recipe import Recipe
from hab_ppo.rows import binary_entries
from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec, check_options
from hab_tasks.io.threads import use_one_thread
from hab_tasks.registration import imported_id
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.typed_values import read_value

WEIGHTS = Path(__file__).parent / "weights"
REMOVED = {"map_memory": False, "mirrors": False, "stop_weight": 1.0}
"""Entries of recipes that earlier versions had, with the values in weights that ship."""

ROWS = 16
"""Episodes played at a time."""


class LoadedPolicy(NamedTuple):
    """A trained policy, and the recipe that it was trained by."""

    policy: Policy
    recipe: Recipe


def load_policy(setup: AgentSetup, path: Path, env_id: str | None = None) -> LoadedPolicy:
    """Loads a policy from a file of weights, to the setup's device.

    Args:
        setup: The agent's setup.
        path: The file.
        env_id: The environment that it must be of, if any; another's module is not imported.

    Raises:
        PolicyFileError: The file cannot be used, or is of another environment or robot.
    """
    tensors, about = checkpoint.load(path)
    recipe = recipe_of(about, path)
    trained_in = recipe.env.reference.rpartition(":")[2]
    if env_id is not None and trained_in != env_id.rpartition(":")[2]:
        raise PolicyFileError(f"{path} was trained in {trained_in}, not {env_id}.")
    own, asked = recipe.env.robot_reference, setup.robot or DEFAULT_ROBOT.uid
    if own != asked:
        raise PolicyFileError(f"{path} was trained with the robot {own}, not {asked}.")
    spaces = setup.spaces_of(imported_id(recipe.env.reference), spec_of(recipe))
    network = recipe.preset.network
    layout = ObservationLayout.of(spaces.observation, network.image_block_px)
    policy = new_policy(layout, spaces.action, network, 0, binary_entries(recipe))
    checkpoint.load_network(policy, tensors, path)
    return LoadedPolicy(policy.to(setup.device), recipe)


class PolicyAgent:
    """Acts with the most likely actions of a policy, or with drawn ones if its recipe says so."""

    def __init__(self, setup: AgentSetup, path: Path) -> None:
        """Loads the weights of a file.

        Raises:
            PolicyFileError: The file cannot be used, or is of another environment.
        """
        use_one_thread()
        self._policy, recipe = load_policy(setup, path, setup.env_id)
        self.spec = replace(spec_of(recipe), files=(str(path),))
        self._device, self._repeat = setup.device, recipe.env.action_repeat
        self._age = torch.zeros(0, dtype=torch.int64)  # steps of each row's episode
        self._draws = recipe.draws_actions
        self._random: list[np.random.Generator] = []
        self._actions = torch.zeros(0, 0)
        self._memory, self._starts = self._policy.no_memory(0), torch.zeros(0, dtype=torch.bool)

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts episodes in the rows of `mask` (N,) bool, seeded with `seeds` (N,)."""
        if len(self._starts) != len(mask):
            self._memory = self._policy.no_memory(len(mask))
            self._starts = torch.ones(len(mask), dtype=torch.bool)
            self._age = torch.zeros(len(mask), dtype=torch.int64)
            self._random = [np.random.default_rng(seed) for seed in seeds]
        self._starts = self._starts | mask.cpu()
        self._age[mask.cpu()] = 0
        for row in mask.nonzero()[:, 0].tolist():
            self._random[row] = np.random.default_rng(seeds[row])

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, A) float32, or cells (N, 1) of a discrete space."""
        due = self._age % self._repeat == 0
        if due.any():
            self._decide(obs, due)
        self._age += 1
        return self._actions.clone()

    def _decide(self, obs: Mapping[str, Any], due: Tensor) -> None:
        """Chooses the actions of the rows `due` (N,) bool; the others repeat theirs."""
        seen = self._policy.layout.read(obs).to(self._device)
        rows = [one if now else None for one, now in zip(self._random, due, strict=True)]
        noise = RowNoise(rows) if self._draws else None
        acted = self._policy.choose(seen, self._memory, self._starts.to(self._device), noise)
        actions = torch.from_numpy(self._policy.head.to_env(acted.actions)).reshape(len(due), -1)
        first = self._actions.shape != actions.shape
        self._actions = actions if first else torch.where(due[:, None], actions, self._actions)
        chosen = due.to(self._device)[None, :, None]
        self._memory = torch.where(chosen, acted.memory, self._memory)
        self._starts = self._starts & ~due

    def report(self) -> list[AgentReport]:
        """Returns empty reports."""
        return [AgentReport() for _ in self._starts]


def recipe_of(about: Mapping[str, Any], path: Path) -> Recipe:
    """Returns the recipe in the description of a file.

    Raises:
        PolicyFileError: It is not of this version.
    """
    where = f"{path} has no recipe of this version: recipe"
    return read_value(Recipe, _without_removed(about.get("recipe")), where, PolicyFileError)


def _without_removed(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    kept = {k: v for k, v in value.items() if k not in REMOVED or v != REMOVED[k]}
    return {key: _without_removed(entry) for key, entry in kept.items()}


def spec_of(recipe: Recipe) -> AgentSpec:
    """Returns the environment options that a recipe's policy needs."""
    env = recipe.env
    return AgentSpec(
        name=f"PPO {recipe.name}",
        control_mode=env.control_mode,
        obs_mode=env.obs_mode,
        target_frame="ee" if env.target_frame == "ee" else "base",
        handle_position=env.handle_position,
        cameras=env.cameras,
        invisible_arm=env.invisible_arm,
        proprioception=env.proprioception,
        rows=ROWS,
    )


def make_agent(name: str, setup: AgentSetup) -> PolicyAgent:
    """Returns the agent of a recipe.

    Option: ``weights``, the path of a file of weights or of a run's folder; by default, the
    weights that ship with the package.

    Raises:
        PolicyFileError: No weights ship for this recipe, or the file cannot be used.
        UnknownNameError: An option is unknown.
    """
    check_options(setup, {"weights": None})
    if "weights" in setup.options:
        return PolicyAgent(setup, weights_file(Path(setup.options["weights"])))
    return PolicyAgent(setup, shipped_weights(name, option="weights"))


def shipped_weights(name: str, option: str) -> Path:
    """Returns the file of the weights that ship for a recipe.

    Args:
        name: The recipe.
        option: The agent's option for weights of one's own.

    Raises:
        PolicyFileError: None ship for it.
    """
    shipped = WEIGHTS / f"{name}.safetensors"
    if not shipped.is_file():
        raise PolicyFileError(
            f"No weights ship for {name}; train them with `hab-ppo train {name}` and give "
            f"--option {option}=DIR."
        )
    return shipped


def weights_file(path: Path) -> Path:
    """Returns the file of weights at a path: itself, or the best ones of a run's folder."""
    path = path.expanduser()
    return path / "best.safetensors" if path.is_dir() else path
