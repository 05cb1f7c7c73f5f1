"""Observations of one row as messages, and what a server tells of the observations it needs.

A message is ``{"state": (D,), "images": {camera: (H, W, 3) uint8}, "prompt": str}``. The state has
proprioception first, then the targets; ``depth`` and other textures are groups like ``images``;
``camera`` holds the matrices of each camera. The prompt is ``task_description`` in vla-eval.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from torch import Tensor

from hab_eval.integrations.protocols import RemoteError
from hab_tasks.agent import AgentSpec
from hab_tasks.engine.sensors import ObsEntry
from hab_tasks.errors import OptionError, shown

PROMPT = {"openpi": "prompt", "vla-eval": "task_description"}
"""Protocol -> key of the instruction."""

SPEC_FIELDS = (
    *("control_mode", "obs_mode", "target_frame", "handle_position", "targets", "instruction"),
    *("cameras", "camera_size_px", "camera_hfov_rad"),
)
"""Fields of an agent's spec that a server tells, and that are options of the remote agent."""


def to_message(obs: Any, prompt: str) -> dict[str, Any]:
    """Returns the observation of one row; `prompt` is the key of the instruction."""
    if isinstance(obs, Tensor):
        return {"state": _row(obs)}
    entries = [x for group in ("agent", "extra") for x in obs.get(group, {}).values()]
    message: dict[str, Any] = {}
    if entries:
        message["state"] = np.concatenate([_row(entry).reshape(-1) for entry in entries])
    for camera, textures in obs.get("sensor_data", {}).items():
        for texture, image in textures.items():
            message.setdefault(_group(texture), {})[camera] = _row(image)
    for camera, matrices in obs.get("sensor_param", {}).items():
        known = {name: _row(matrix) for name, matrix in matrices.items()}
        message.setdefault("camera", {})[camera] = known
    if "instruction" in obs:
        message[prompt] = obs["instruction"][0]
    return message


def _group(texture: str) -> str:
    """Returns the group of a texture's images in a message."""
    return "images" if texture == "rgb" else texture


def _row(value: Any) -> np.ndarray:
    return np.ascontiguousarray(torch.as_tensor(value)[0].numpy())


class MessageReader:
    """Reads messages as observations of an agent, and checks them."""

    def __init__(
        self, spec: AgentSpec, entries: Sequence[ObsEntry], space: spaces.Space[Any], prompt: str
    ) -> None:
        """Takes the agent's spec, entries of the state and observation space of one row."""
        self._spec, self._entries, self._space, self._prompt = spec, entries, space, prompt

    def read(self, message: Any) -> Any:
        """Returns an observation of one row: tensors (1, ...).

        Raises:
            RemoteError: An entry is missing or has another shape; the message names it.
        """
        if not isinstance(message, Mapping):
            raise RemoteError(f"An observation is {shown(message)}; a map is valid.")
        if self._spec.obs_mode == "state":
            return _tensor(message, ("state",), self._space)
        assert isinstance(self._space, spaces.Dict)
        obs = self._state(message)
        if "sensor_data" in self._space.spaces:
            obs["sensor_data"] = self._images(message)
            if "camera" in message:
                obs["sensor_param"] = _matrices(message["camera"], self._space["sensor_param"])
        if self._spec.instruction is not None:
            prompt = message.get(self._prompt)
            if not isinstance(prompt, str):
                raise RemoteError(f"The observation has no text {self._prompt!r}.")
            obs["instruction"] = [prompt]
        return obs

    def _state(self, message: Mapping[str, Any]) -> dict[str, Any]:
        sizes = [int(np.prod(entry.shape)) for entry in self._entries]
        if not sizes:
            return {}
        flat = spaces.Box(-np.inf, np.inf, (sum(sizes),), np.float32)
        parts = _tensor(message, ("state",), flat).split(sizes, dim=1)
        groups: dict[str, dict[str, Tensor]] = {}
        for entry, part in zip(self._entries, parts, strict=True):
            groups.setdefault(entry.group, {})[entry.name] = part.reshape(1, *entry.shape)
        return dict(groups)

    def _images(self, message: Mapping[str, Any]) -> dict[str, dict[str, Tensor]]:
        cameras: Any = self._space["sensor_data"]  # type: ignore[index]
        return {
            camera: {
                texture: _tensor(message, (_group(texture), camera), space)
                for texture, space in textures.items()
            }
            for camera, textures in cameras.items()
        }


def _matrices(message: Any, cameras: Any) -> dict[str, dict[str, Tensor]]:
    return {
        camera: {name: _tensor(message, (camera, name), space) for name, space in matrices.items()}
        for camera, matrices in cameras.items()
    }


def _tensor(message: Any, path: Sequence[str], space: spaces.Space[Any]) -> Tensor:
    """Returns an array of a message as a tensor (1, ...), if it has the shape of `space`."""
    where, value = "/".join(path), message
    for name in path:
        value = value.get(name) if isinstance(value, Mapping) else None
    shape, dtype = space.shape or (), np.dtype(space.dtype)
    wanted = f"{dtype} {list(shape)}"
    if not isinstance(value, np.ndarray):
        raise RemoteError(f"The observation has no array {where!r}; {wanted} is expected.")
    both_floats = value.dtype.kind == dtype.kind == "f"
    if value.shape != shape or not (value.dtype == dtype or both_floats):
        found = f"{value.dtype} {list(value.shape)}"
        raise RemoteError(f"{where!r} of the observation is {found}; {wanted} is expected.")
    return torch.from_numpy(value.astype(dtype, copy=False))[None]


def spec_params(spec: AgentSpec) -> dict[str, Any]:
    """Returns the observations and control mode of a spec, for messages."""
    known = {name: getattr(spec, name) for name in SPEC_FIELDS}
    return {**known, "cameras": None if spec.cameras is None else list(spec.cameras)}


def with_params(spec: AgentSpec, params: Mapping[str, Any]) -> AgentSpec:
    """Returns a spec with the values of `spec_params`; other names are ignored."""
    known = {name: params[name] for name in SPEC_FIELDS if name in params}
    if isinstance(known.get("cameras"), list):
        known["cameras"] = tuple(known["cameras"])
    return replace(spec, **known)


def parse_params(options: Mapping[str, str]) -> dict[str, Any]:
    """Returns the values of `SPEC_FIELDS` in options of the command line.

    Raises:
        OptionError: A value is of the wrong type.
    """
    kinds = {field.name: str(field.type) for field in fields(AgentSpec)}
    return {
        name: _parsed(name, value, kinds[name])
        for name, value in options.items()
        if name in SPEC_FIELDS
    }


def _parsed(name: str, text: str, kind: str) -> Any:
    if name == "cameras":
        return tuple(text.split("+"))
    if name == "instruction" and text == "none":
        return None
    if kind == "bool":
        if text not in ("true", "false"):
            raise OptionError.of_value(f"--option {name}", text, "true or false")
        return text == "true"
    if kind not in ("int", "float"):
        return text
    try:
        return int(text) if kind == "int" else float(text)
    except ValueError:
        valid = "a whole number" if kind == "int" else "a number"
        raise OptionError.of_value(f"--option {name}", text, valid) from None
