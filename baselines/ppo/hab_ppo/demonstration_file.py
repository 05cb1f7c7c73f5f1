"""Files of demonstrations: examples, and the paths that were followed in them; their checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from hab_ppo import checkpoint
from hab_ppo.agent import spec_of
from hab_ppo.checkpoint import PolicyFileError
from hab_ppo.examples import Examples
from hab_ppo.observation import ObservationLayout
from hab_ppo.recipe import EnvConfig, Recipe
from hab_ppo.retiming import Stretch
from hab_tasks.agent_spaces import agent_spaces
from hab_tasks.registration import imported_id
from hab_tasks.typed_values import to_json

KIND = "demonstrations"

SAME = (
    *("robot", "control_mode", "obs_mode", "target_frame", "handle_position"),
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


DTYPES = {
    "state": (torch.float32,),
    "images": (torch.uint8, torch.float16),
    "actions": (torch.float32, torch.int64),
    "lengths": (torch.int64,),
    "path_episodes": (torch.int64,),
    "path_stretches": (torch.float64,),
    "path_points": (torch.float64,),
    "path_drives": (torch.float64,),
}
WIDTHS = {"path_episodes": 2, "path_stretches": 6, "path_points": 3, "path_drives": 2}
DIMENSIONS = {"state": (2,), "images": (4,), "actions": (1, 2), "lengths": (1,)}


def find_fault(tensors: Mapping[str, Tensor], num_episodes: int) -> str | None:
    """Returns what is wrong with the tensors of a file; None if nothing is.

    Args:
        tensors: Those of `demonstration_file.write_examples`.
        num_episodes: Number of the recipe's training episodes.
    """
    for name, dtypes in DTYPES.items():
        if name not in tensors and name != "images":
            return f"{name} is missing"
        if name in tensors and not _has_form(name, tensors[name], dtypes):
            return f"{name} is {tensors[name].dtype} of shape {tuple(tensors[name].shape)}"
    finite = {name: tensors[name] for name in ("state", "actions", "path_points")}
    finite |= {"images": tensors["images"]} if "images" in tensors else {}
    finite["path_stretches"] = tensors["path_stretches"][:, :3]  # NaN: the end is the last point
    for name, values in finite.items():
        if not bool(torch.isfinite(values).all()):
            return f"{name} has values that are not finite"
    return _wrong_sizes(tensors, num_episodes)


def check_sizes(path: Path, examples: Examples, recipe: Recipe) -> None:
    """Checks that examples have the observations and actions of a recipe.

    Raises:
        PolicyFileError: State, images or actions have another shape.
    """
    spaces = agent_spaces(imported_id(recipe.env.reference), spec_of(recipe))
    layout = ObservationLayout.of(spaces.observation, recipe.preset.network.image_block_px)
    images = None if examples.images is None else tuple(examples.images.shape[1:])
    for name, found, wanted in (
        ("state", tuple(examples.state.shape[1:]), (layout.state_size,)),
        ("images", images, layout.image_shape),
        ("actions", tuple(examples.actions.shape[1:]), spaces.action.shape),
    ):
        if found != wanted:
            raise PolicyFileError(f"{path} has {name} of shape {found}, {recipe.name} {wanted}.")


def _has_form(name: str, tensor: Tensor, dtypes: tuple[torch.dtype, ...]) -> bool:
    if name in WIDTHS:
        return tensor.dtype in dtypes and tensor.dim() == 2 and tensor.shape[1] == WIDTHS[name]
    return tensor.dtype in dtypes and tensor.dim() in DIMENSIONS[name]


def _wrong_sizes(tensors: Mapping[str, Tensor], num_episodes: int) -> str | None:
    """Returns which parts do not fit each other; None if all do."""
    episodes, stretches = tensors["path_episodes"], tensors["path_stretches"]
    steps, points = len(tensors["state"]), len(tensors["path_points"])
    parts = (
        ("lengths", tensors["lengths"], steps, 1),
        ("path_episodes", episodes[:, 1], len(stretches), 0),
        ("path_stretches", stretches[:, 0], points, 1),
    )
    for name, sizes, total, least in parts:
        if bool(((sizes < least) | (sizes > total)).any()) or sizes.sum().item() != total:
            return f"{name} does not add up to {total}"
    if steps == 0:
        return "there is no demonstration"
    pairs = (("actions", steps), ("images", steps), ("path_drives", points))
    for name, wanted in pairs:
        if name in tensors and len(tensors[name]) != wanted:
            return f"{name} has {len(tensors[name])} rows instead of {wanted}"
    numbers = episodes[:, 0]
    if bool(((numbers < 0) | (numbers >= num_episodes)).any()):
        return f"path_episodes has an episode beyond the recipe's {num_episodes}"
    return None
