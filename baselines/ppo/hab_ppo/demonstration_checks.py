"""Checks of files of demonstrations, before anything is cloned from them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor

from hab_ppo.agent import spec_of
from hab_ppo.errors import PolicyFileError
from hab_ppo.examples import Examples
from hab_ppo.observation import ObservationLayout
from hab_ppo.recipe import Recipe
from hab_tasks.agent_spaces import agent_spaces
from hab_tasks.registration import imported_id

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
