"""Files of weights of the navigator."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hab_ppo
from hab_ppo import checkpoint
from hab_ppo.errors import PolicyFileError

from hab_navigator.network import GoalNetwork

NAVIGATOR = "navigator"
"""Name of the agent."""

WEIGHTS = "navigator.safetensors"
"""File of weights in a run's folder, and in the package."""

SHIPPED = Path(hab_ppo.__file__).parent / "navigation"
"""Submissions name the file there."""

KIND = "navigator"
"""Entry ``kind`` of the description of such a file."""


def save(path: Path, network: GoalNetwork, about: dict[str, Any]) -> None:
    """Writes a file of weights."""
    checkpoint.save(path, dict(network.state_dict()), about)


def load(path: Path) -> tuple[GoalNetwork, dict[str, Any]]:
    """Returns the network of a file, and the file's description.

    Raises:
        PolicyFileError: Not such a file.
    """
    tensors, about = checkpoint.load(path)
    network = GoalNetwork()
    shapes = {name: value.shape for name, value in network.state_dict().items()}
    if about.get("kind") != KIND or {n: v.shape for n, v in tensors.items()} != shapes:
        raise PolicyFileError(f"{path} is not a file of weights of this version's navigator.")
    network.load_state_dict(tensors)
    return network.eval(), about


def shipped_navigator() -> Path:
    """Returns the weights that ship."""
    return SHIPPED / WEIGHTS


def is_navigator(path: Path) -> bool:
    """Whether a file holds weights of a navigator.

    Raises:
        PolicyFileError: It is not a file of weights.
    """
    return checkpoint.load(path)[1].get("kind") == KIND


def is_run(folder: Path) -> bool:
    """Whether a folder is that of a navigator's run."""
    return (folder / WEIGHTS).is_file()


def ship(run: Path) -> Path:
    """Copies the weights of a run to the package; returns the file.

    Raises:
        PolicyFileError: The file cannot be used.
    """
    network, about = load(run / WEIGHTS)
    save(shipped_navigator(), network, about)
    return shipped_navigator()
