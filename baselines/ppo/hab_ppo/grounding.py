"""Pick by words and images: learned is where the named object is seen; `pick_blind` picks there.

A U-Net (arXiv 1505.04597) gives each pixel of the color and depth images of both cameras a feature
and the way from its surface to the center of its object. A bag of known words gives the feature
that is looked for.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from hab_ppo import checkpoint
from hab_ppo.agent import make_agent
from hab_ppo.checkpoint import PolicyFileError
from hab_tasks.agent import (
    AgentReport,
    AgentSetup,
    AgentSpec,
    CameraParameters,
    check_options,
    of_rows,
)
from hab_tasks.constants import CAMERA_DEPTH_MAX_M
from hab_tasks.errors import OptionError
from hab_tasks.registration import imported_id
from hab_tasks.robots import DEFAULT_ROBOT as ROBOT

PICK_LANGUAGE = "pick_language"
"""Name of the agent, and of its file of weights."""

HAND = "pick_blind"
"""The policy that moves the hand."""

PICK_ID = "HabPick-v1"
CAMERAS = ("head", "arm")
SIZE_PX = 128
STRIDE_PX = 2
"""A feature is of the upper left pixel of each square of so many."""

WIDTHS = (24, 32, 48, 64)
"""Channels at that resolution, and at each half of it."""

FEATURES = 32
HIDDEN = 64
MIDDLE_M = (0.8, 0.0, 0.7)
"""Points are told to the network relative to this one in the base frame, which is about where
objects are."""

FARTHEST_M = 2.0
"""Points are told as this far at most, in each direction."""

SPEC = AgentSpec(
    name="Pick by language",
    control_mode="ee",
    obs_mode="rgb+depth",
    looks="on demand",
    targets="language",
    instruction="task",
    cameras=CAMERAS,
    camera_size_px=SIZE_PX,
    rows=8,
)
"""What the agent needs of an environment."""

WEIGHTS = "pick_language.safetensors"
"""File of weights in a run's folder."""

SHIPPED = Path(__file__).parent / "language" / WEIGHTS


class Seen(NamedTuple):
    """Images of V views.

    Attributes:
        color: (V, H, W, 3) uint8.
        points_m: (V, H, W, 3) float32, the surface seen at each pixel, in the base frame.
    """

    color: Tensor
    points_m: Tensor


class Grounder(nn.Module):
    """Finds the object that is told.

    Attributes:
        words: The known words.
    """

    _middle_m: Tensor

    def __init__(self, words: Sequence[str]) -> None:
        """Creates a network for these words."""
        super().__init__()
        self.words = tuple(words)
        widths = (6, *WIDTHS)
        self.down = nn.ModuleList(
            nn.Sequential(*_layer(*widths[k : k + 2], stride=2), *_layer(widths[k + 1]))
            for k in range(len(WIDTHS))
        )
        self.wider = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairwise(WIDTHS))
        self.up = nn.ModuleList(nn.Sequential(*_layer(width)) for width in WIDTHS[:-1])
        self.last = nn.Conv2d(WIDTHS[0], FEATURES + 3, 1)
        self.told = nn.Sequential(
            nn.Linear(len(self.words), HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, FEATURES)
        )
        self.register_buffer("_middle_m", torch.tensor(MIDDLE_M), persistent=False)

    def bag(self, instructions: Iterable[str]) -> Tensor:
        """Returns which known words the instructions (N,) have, (N, words)."""
        found = [words_of(instruction) for instruction in instructions]
        return torch.tensor([[float(word in said) for word in self.words] for said in found])

    def forward(self, seen: Seen, told: Tensor) -> tuple[Tensor, Tensor]:
        """Finds objects in the E pictures of all cameras.

        Args:
            seen: Images of E times C views, those of a picture one after another.
            told: (E, Q, words) bags of words, of Q objects each.

        Returns:
            Logits (E, Q, C, h, w) of where an object is, and the centers (E, C, h, w, 3) [m] of the
            objects of which a part is there, in the base frame.
        """
        color = seen.color.permute(0, 3, 1, 2).float() / 127.5 - 1.0
        near = (seen.points_m - self._middle_m).clamp(-FARTHEST_M, FARTHEST_M)
        x = torch.cat((color, near.permute(0, 3, 1, 2)), dim=1)
        passed: list[Tensor] = []
        for block in self.down:
            x = block(x)
            passed.append(x)
        for level in range(len(WIDTHS) - 2, -1, -1):
            wide = interpolate(self.wider[level](x), scale_factor=2.0, mode="nearest")
            x = self.up[level](passed[level] + wide)
        features, inward_m = self.last(x).float().split((FEATURES, 3), dim=1)
        features = features.unflatten(0, (len(told), -1))
        logits = torch.einsum("eqf,ecfhw->eqchw", self.told(told), features) / FEATURES**0.5
        surface_m = seen.points_m[:, ::STRIDE_PX, ::STRIDE_PX]
        centers_m = surface_m + inward_m.permute(0, 2, 3, 1)
        return logits, centers_m.unflatten(0, (len(told), -1))


def _layer(before: int, after: int | None = None, stride: int = 1) -> list[nn.Module]:
    after = after or before
    return [nn.Conv2d(before, after, 3, stride, 1), nn.GroupNorm(4, after), nn.ReLU(inplace=True)]


def words_of(instruction: str) -> frozenset[str]:
    """Returns the words that name the object: all before those of its place."""
    return frozenset(re.findall(r"[a-z]+", instruction.lower().partition(" from ")[0]))


def base_from_cameras(cameras: Mapping[str, CameraParameters], felt: Mapping[str, Any]) -> Tensor:
    """Returns the poses (N, C, 4, 4) of the cameras in the base frame, by what the arm feels.

    Args:
        cameras: The cameras of `CAMERAS`.
        felt: The group ``agent`` of N observations.
    """
    ee_m, axes = torch.as_tensor(felt["ee_position"]), torch.as_tensor(felt["ee_rotation"])
    x, y = axes[:, :3], axes[:, 3:]
    hand = torch.eye(4).repeat(len(ee_m), 1, 1)
    hand[:, :3, :3] = torch.stack((x, y, torch.linalg.cross(x, y)), dim=2)
    hand[:, :3, 3] = ee_m - ROBOT.ee_offset_m * x
    links = {ROBOT.ee_link: hand, ROBOT.base_link: torch.eye(4).expand_as(hand)}
    mounts = [(cameras[name].link, cameras[name].link_from_camera) for name in CAMERAS]
    return torch.stack([links[k] @ torch.from_numpy(pose).float() for k, pose in mounts], dim=1)


def seen_by(camera: CameraParameters, color: Tensor, depth_m: Tensor, poses: Tensor) -> Seen:
    """Returns what the network sees.

    Args:
        camera: One of the cameras, which are alike but for their mounts.
        color: (N, C, H, W, 3) uint8.
        depth_m: (N, C, H, W) distances along the optical axis.
        poses: (N, C, 4, 4) poses of the cameras in the base frame.
    """
    steps = [torch.arange(size) + 0.5 for size in depth_m.shape[-2:]]
    down, across = torch.meshgrid(*steps, indexing="ij")
    pixels = torch.stack((across, down, torch.ones_like(down)), dim=-1)
    rays = pixels @ torch.from_numpy(np.linalg.inv(camera.intrinsics_px)).float().T
    turned = torch.einsum("ncij,hwj->nchwi", poses[..., :3, :3], rays)
    points_m = depth_m[..., None] * turned + poses[..., None, None, :3, 3]
    return Seen(color.flatten(0, 1), points_m.flatten(0, 1))


class Places(NamedTuple):
    """Where the network finds objects in E pictures, Q in each.

    Attributes:
        cells: (E, Q) index of the feature among the flattened (C, h, w) ones.
        centers_m: (E, Q, 3) centers of the objects in the base frame.
    """

    cells: Tensor
    centers_m: Tensor


@torch.no_grad()
def find(network: Grounder, seen: Seen, told: Tensor) -> Places:
    """Returns the most probable places; arguments as of the network."""
    logits, centers_m = network(seen, told)
    cells = logits.flatten(2).argmax(dim=2)
    rows = torch.arange(len(told))[:, None]
    return Places(cells, centers_m.flatten(1, 3)[rows, cells])


class PickLanguageAgent:
    """Looks once, decides where the object is, and picks there."""

    def __init__(self, setup: AgentSetup, path: Path) -> None:
        """Loads the weights of a file.

        Raises:
            PolicyFileError: The file cannot be used.
            OptionError: The environment is another one.
        """
        if imported_id(setup.env_id) != PICK_ID:
            raise OptionError(f"{PICK_LANGUAGE} acts in {PICK_ID}, not {setup.env_id}.")
        self._network = load(path)[0]
        self._hand = make_agent(HAND, replace(setup, options={}))
        self.spec = replace(SPEC, files=(str(path), *self._hand.spec.files))
        self._cameras = setup.spaces(self.spec).cameras
        self._points_m, self._new = torch.zeros(0, 3), torch.zeros(0, dtype=torch.bool)

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts episodes in the rows of `mask` (N,) bool; nothing is drawn at random."""
        self._hand.reset(mask, seeds)
        if len(self._new) != len(mask):
            self._points_m, self._new = torch.zeros(len(mask), 3), mask.cpu().clone()
        self._new |= mask.cpu()

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, 4) float32 of ``ee``.

        Raises:
            OptionError: The observation is not that of the agent's `spec`.
        """
        if self._new.any():
            rows = self._new.nonzero()[:, 0].tolist()
            for row in rows:  # one by one, as sums of a batch are rounded otherwise
                self._points_m[row] = self._look(of_rows(obs, [row]))
            self._new[:] = False
        away_m = self._points_m - torch.as_tensor(obs["agent"]["ee_position"])
        return self._hand.act({"agent": obs["agent"], "extra": {"object_start_from_ee": away_m}})

    def report(self) -> list[AgentReport]:
        """Returns empty reports."""
        return self._hand.report()

    def _look(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns where the object is that an observation tells of, (3,) in the base frame."""
        images = obs.get("sensor_data", {})
        if "instruction" not in obs or any("rgb" not in images.get(name, ()) for name in CAMERAS):
            raise OptionError(
                f"{PICK_LANGUAGE} needs obs['instruction'] and color of the cameras "
                f"{' and '.join(CAMERAS)}; make the environment by the agent's spec."
            )
        color, depth = (
            torch.stack([torch.as_tensor(images[name][kind]) for name in CAMERAS], dim=1)
            for kind in ("rgb", "depth")
        )
        poses = base_from_cameras(self._cameras, obs["agent"])
        seen = seen_by(self._cameras["head"], color, CAMERA_DEPTH_MAX_M * depth[..., 0], poses)
        told = self._network.bag(obs["instruction"])
        return find(self._network, seen, told[:, None]).centers_m[0, 0]


def pick_language(setup: AgentSetup) -> PickLanguageAgent:
    """Returns the agent.

    Option: ``weights``, a file or the folder of a run; by default, the weights that ship.

    Raises:
        PolicyFileError: The file cannot be used.
        UnknownNameError: An option is unknown.
    """
    check_options(setup, {"weights": None})
    path = Path(setup.options.get("weights", SHIPPED)).expanduser()
    return PickLanguageAgent(setup, path / WEIGHTS if path.is_dir() else path)


# Files ---------------------------------------------------------------------------------------


def save(path: Path, network: Grounder, about: dict[str, Any]) -> None:
    """Writes a file of weights."""
    told = {**about, "kind": PICK_LANGUAGE, "words": network.words}
    checkpoint.save(path, dict(network.state_dict()), told)


def load(path: Path) -> tuple[Grounder, dict[str, Any]]:
    """Returns the network of a file, and the file's description.

    Raises:
        PolicyFileError: Not such a file.
    """
    tensors, about = checkpoint.load(path)
    other = PolicyFileError(f"{path} is not a file of weights of this version's {PICK_LANGUAGE}.")
    if about.get("kind") != PICK_LANGUAGE:
        raise other
    network = Grounder(about["words"])
    shapes = {name: value.shape for name, value in network.state_dict().items()}
    if {name: value.shape for name, value in tensors.items()} != shapes:
        raise other
    network.load_state_dict(tensors)
    return network.eval(), about
