"""Files of weights and checkpoints: safetensors, with a JSON description in the header.

Both are one file, replaced atomically. Weights hold the network with its normalisers; a checkpoint
also the optimizer, the moments of the returns and the position of the run.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors import torch as safe
from torch import Tensor

from hab_ppo.network import Policy
from hab_ppo.ppo import PPO
from hab_tasks.errors import HabError
from hab_tasks.io.files import written_aside

FORMAT = 1
"""Version of both kinds of file."""

KEY = "hab_ppo"
Tensors = dict[str, Tensor]


class PolicyFileError(HabError):
    """A file of weights or a checkpoint that cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Position:
    """Where a run is. With the recipe and the seed, it determines all random numbers.

    Attributes:
        update: Number of updates made.
        steps: Environment steps made, all ranks together.
        evaluated: Number of the last evaluation: steps // `Recipe.evaluation_steps`.
        seconds: Time spent, over all starts of the run.
        success: Success rate of the last evaluation; None before the first.
        best_success: That of the best weights.
        best_steps: Steps of the best weights.
    """

    update: int = 0
    steps: int = 0
    evaluated: int = 0
    seconds: float = 0.0
    success: float | None = None
    best_success: float | None = None
    best_steps: int = 0


def save(path: Path, tensors: Tensors, about: dict[str, Any]) -> None:
    """Writes a file of tensors with its description; the format is added."""
    header = {KEY: json.dumps({"format": FORMAT, **about})}
    cpu = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with written_aside(path) as scratch:
        scratch.write_bytes(safe.save(cpu, header))


def read(path: Path) -> bytes:
    """Returns the content of a file.

    Raises:
        PolicyFileError: It cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise PolicyFileError(f"{path} cannot be read: {error.strerror}.") from error


def parse(data: bytes, name: object) -> tuple[Tensors, dict[str, Any]]:
    """Returns tensors and description of a file's content.

    Raises:
        PolicyFileError: Not such a file, or of another format.
    """
    try:
        tensors = safe.load(data)
        size = int.from_bytes(data[:8], "little")
        about = json.loads(json.loads(data[8 : 8 + size])["__metadata__"][KEY])
        found = about["format"]
    except (SafetensorError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise PolicyFileError(f"{name} is not a file of weights of hab-ppo.") from error
    if found != FORMAT:
        raise PolicyFileError(
            f"{name} has format {found}, this version of hab-ppo reads format {FORMAT}: train "
            "again, or install the version that wrote it."
        )
    return tensors, about


def load(path: Path) -> tuple[Tensors, dict[str, Any]]:
    """Returns tensors and description of a file; see `read` and `parse`."""
    return parse(read(path), path)


def network_tensors(policy: Policy) -> Tensors:
    """Returns weights and normalisers of a policy."""
    return {f"network/{name}": value for name, value in policy.state_dict().items()}


def load_network(policy: Policy, tensors: Tensors, name: object) -> None:
    """Sets weights and normalisers of a policy.

    Raises:
        PolicyFileError: They are of another network, or not finite.
    """
    own = {k.removeprefix("network/"): v for k, v in tensors.items() if k.startswith("network/")}
    wanted = policy.state_dict()
    different = sorted(
        key
        for key in own.keys() | wanted.keys()
        if key not in own
        or key not in wanted
        or (own[key].shape, own[key].dtype) != (wanted[key].shape, wanted[key].dtype)
    )
    if different:
        raise PolicyFileError(
            f"{name} is of another network or other observations: {different[0]} differs."
        )
    broken = [key for key, value in own.items() if not bool(torch.isfinite(value).all())]
    if broken:
        raise PolicyFileError(f"{name} has values that are not finite: {broken[0]}.")
    policy.load_state_dict(own)
    policy.state_normalizer.refresh()
    if policy.image_normalizer is not None:
        policy.image_normalizer.refresh()


def learner_tensors(learner: PPO) -> Tensors:
    """Returns all that the learner needs to continue."""
    tensors = network_tensors(learner.policy)
    for name, value in learner.return_moments.state_dict().items():
        tensors[f"returns/{name}"] = value
    for number, values in learner.optimizer.state_dict()["state"].items():
        for name, value in values.items():
            tensors[f"optimizer/{number}/{name}"] = value
    return tensors


def load_learner(learner: PPO, tensors: Tensors, name: object) -> None:
    """Sets the state of a learner to that of `learner_tensors`."""
    load_network(learner.policy, tensors, name)
    state: dict[int, Tensors] = {}
    moments: Tensors = {}
    for key, value in tensors.items():
        kind, _, rest = key.partition("/")
        if kind == "returns":
            moments[rest] = value
        elif kind == "optimizer":
            number, _, entry = rest.partition("/")
            state.setdefault(int(number), {})[entry] = value
    learner.return_moments.load_state_dict(moments)
    learner.return_moments.refresh()
    groups = learner.optimizer.state_dict()["param_groups"]
    learner.optimizer.load_state_dict({"state": state, "param_groups": groups})


def position_json(position: Position) -> dict[str, Any]:
    """Returns a position for the description of a checkpoint."""
    return asdict(position)
