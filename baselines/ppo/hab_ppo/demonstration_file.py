"""Files of demonstrations: examples, and the paths that were followed in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from hab_ppo import checkpoint
from hab_ppo.demonstration_checks import find_fault
from hab_ppo.errors import PolicyFileError
from hab_ppo.examples import Examples
from hab_ppo.recipe import EnvConfig
from hab_ppo.retiming import Stretch
from hab_tasks.typed_values import to_json

KIND = "demonstrations"

SAME = (
    *("control_mode", "obs_mode", "target_frame", "handle_position"),
    *("scene_dataset", "objects", "split", "episode_seed"),
)
"""Entries of `EnvConfig` in which demonstrations and a recipe have to agree, beside the id."""


ABOUT = {"agent", "seed", "counts"}
"""Entries of the description that a run copies."""


class Followed(NamedTuple):
    """The path of a demonstration.

    Attributes:
        number: Index of the training episode.
        path: The stretches.
    """

    number: int
    path: list[Stretch]


class DemonstrationFile(NamedTuple):
    """Content of a file.

    Attributes:
        examples: The examples of all demonstrations.
        followed: Their paths, in the same order.
        about: The description: agent, seed, counts.
    """

    examples: Examples
    followed: list[Followed]
    about: dict[str, Any]


def write_examples(
    path: Path,
    examples: Examples,
    followed: Sequence[Followed],
    env: EnvConfig,
    about: dict[str, Any],
) -> None:
    """Writes demonstrations made in an environment to a file, atomically; `about` is added."""
    tensors = examples.tensors() | _packed(followed)
    checkpoint.save(path, tensors, {"kind": KIND, "env": to_json(env), **about})


def read_examples(path: Path, env: EnvConfig) -> DemonstrationFile:
    """Returns the content of a file.

    Raises:
        PolicyFileError: Not such a file, of another environment than `env`, or damaged.
    """
    tensors, about = checkpoint.load(path)
    found: Any = about.get("env")
    known = isinstance(found, dict) and found.keys() >= {"env", *SAME}
    if about.get("kind") != KIND or not known or not about.keys() >= ABOUT:
        raise PolicyFileError(f"{path} is not a file of demonstrations of hab-ppo.")
    if str(found["env"]).rpartition(":")[2] != env.env.rpartition(":")[2]:  # imports nothing
        raise PolicyFileError(f"{path} has demonstrations of {found['env']}, not {env.env}.")
    for name in SAME:
        if found[name] != getattr(env, name):
            raise PolicyFileError(
                f"{path} has demonstrations with {name} {found[name]!r}, not "
                f"{getattr(env, name)!r}."
            )
    if fault := find_fault(tensors, env.num_episodes):
        raise PolicyFileError(f"{path} is damaged: {fault}. hab-ppo demonstrate makes it again.")
    return DemonstrationFile(Examples.of_tensors(tensors), _unpacked(tensors), about)


def _packed(followed: Sequence[Followed]) -> dict[str, Tensor]:
    """Returns paths as tensors: episodes, stretches and points; NaN where there is nothing."""
    stretches = [stretch for one in followed for stretch in one.path]
    nothing = np.full((0, 3), np.nan)
    points = [nothing, *(s.points_m for s in stretches)]
    drives = [np.full((0, 2), np.nan)]
    drives += [_or_nan(s.drives, (len(s.points_m), 2)) for s in stretches]
    numbers = np.array([[one.number, len(one.path)] for one in followed]).reshape(-1, 2)
    facts = [[len(s.points_m), s.gripper, s.reached_m, *_or_nan(s.end_m, 3)] for s in stretches]
    return {
        "path_episodes": torch.from_numpy(numbers.astype(np.int64)),
        "path_stretches": torch.from_numpy(np.array(facts, dtype=float).reshape(-1, 6)),
        "path_points": torch.from_numpy(np.concatenate(points).astype(float)),
        "path_drives": torch.from_numpy(np.concatenate(drives).astype(float)),
    }


def _unpacked(tensors: dict[str, Tensor]) -> list[Followed]:
    points_m, drives = tensors["path_points"].numpy(), tensors["path_drives"].numpy()
    stretches, at = [], 0
    for size, gripper, reached_m, *end_m in tensors["path_stretches"].tolist():
        part = slice(at, at + int(size))
        at = part.stop
        stretches.append(
            Stretch(
                points_m=points_m[part],
                gripper=gripper,
                drives=None if np.isnan(drives[part]).any() else drives[part],
                end_m=None if np.isnan(end_m).any() else np.array(end_m),
                reached_m=reached_m,
            )
        )
    ends = tensors["path_episodes"][:, 1].cumsum(0).tolist()
    return [
        Followed(number, stretches[end - count : end])
        for (number, count), end in zip(tensors["path_episodes"].tolist(), ends, strict=True)
    ]


def _or_nan(values: Any, shape: Any) -> Any:
    return np.full(shape, np.nan) if values is None else values
