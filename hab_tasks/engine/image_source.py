"""Choice of what computes the images of an environment: rays on the CPU, or a renderer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mani_skill.envs.utils.observations import parse_obs_mode_to_struct

from hab_tasks.errors import OptionError
from hab_tasks.rendering import RAYS, resolve_backend

WITHOUT_IMAGES = ("state", "state_dict", "none")
"""Observation modes without images."""

_RENDERED_ONLY = ("shader_pack", "shader_config", "use_stereo_depth")
"""Entries of `sensor_configs` that need a renderer."""


@dataclass(frozen=True, kw_only=True)
class ImageSource:
    """What computes an environment's images.

    Attributes:
        renderer: ManiSkill's render_backend; ``none`` opens no graphics device.
        casts_rays: Whether rays compute the observed images.
    """

    renderer: str
    casts_rays: bool = False


def choose_source(backend: str, options: Mapping[str, Any]) -> ImageSource:
    """Returns the source of an environment's images.

    Args:
        backend: ``auto`` casts rays for observations of depth without colour, and renders
            everything else; ``rays`` never renders observations; other names are the
            renderer's.
        options: ManiSkill's options: `obs_mode`, `render_mode` and `sensor_configs`.

    Raises:
        UnknownNameError: Unknown backend.
        OptionError: Rays were requested for what only a renderer delivers.
        RenderingUnavailableError: A renderer is needed, but there is no Vulkan device.
    """
    obs_mode, render_mode = options.get("obs_mode") or "state", options.get("render_mode")
    images = obs_mode not in WITHOUT_IMAGES
    reason = _needs_renderer(obs_mode, options)
    if backend == RAYS:
        # ManiSkill's point clouds have colours where available.
        if reason is not None and not (reason.colour and obs_mode == "pointcloud"):
            raise OptionError.of_value("render_backend", backend, reason.words)
    elif backend != "auto" or not images or reason is not None:
        return ImageSource(renderer=resolve_backend(backend, images or render_mode is not None))
    humans = render_mode not in (None, "sensors")
    return ImageSource(renderer=resolve_backend("auto", humans), casts_rays=images)


@dataclass(frozen=True, kw_only=True)
class _Reason:
    """Why a renderer is needed: valid alternatives in words; whether it is only colour."""

    words: str
    colour: bool = False


def _needs_renderer(obs_mode: str, options: Mapping[str, Any]) -> _Reason | None:
    """Returns why rays cannot compute the observed images, or None."""
    configs = options.get("sensor_configs") or {}
    for config in (configs, *(c for c in configs.values() if isinstance(c, Mapping))):
        for name in _RENDERED_ONLY:
            if name in config:
                return _Reason(words=f"'auto', 'cpu' or 'gpu' with {name!r} in sensor_configs")
    seen = parse_obs_mode_to_struct(obs_mode).visual
    if seen.rgb or seen.normal or seen.albedo:
        words = (
            f"'auto', 'cpu' or 'gpu' with obs_mode={obs_mode!r}, which needs a renderer; rays "
            "deliver depth, position and segmentation"
        )
        return _Reason(words=words, colour=seen.rgb)
    return None
