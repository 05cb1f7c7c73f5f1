"""Validation of ManiSkill's options, and the choice of rays on the CPU or a renderer for images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mani_skill.envs.sapien_env import BaseEnv

from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.option_values import entries
from hab_tasks.rendering import RAYS, resolve_backend
from hab_tasks.simulator import CPU_SIM_BACKENDS, INHERITED_OPTIONS, parse_obs_mode_to_struct

ADVICE = (
    "Several rows run on CPU cores: gymnasium.make_vec('hab_tasks:HabPick-v1', num_envs=N), about "
    "1,700 steps/s with 16 rows on two cores (docs/speed.md)."
)
OBS_MODES = "'state', 'state_dict', 'none', or textures joined by '+', e.g. 'rgb+depth'"
RENDER_MODES = ("human", "rgb_array", "sensors", "all")


def check_inherited(env: str, own: Mapping[str, Any], options: Mapping[str, Any]) -> None:
    """Rejects options unknown to ManiSkill, and values on which it would fail later.

    `own` are the parameters of the environment itself.

    Raises:
        UnknownNameError: Unknown option, reward mode or render mode.
        OptionError: Invalid observation mode, more than one row, or simulation on a GPU.
    """
    valid = [name for name in (*own, *INHERITED_OPTIONS) if name not in ("self", "kwargs")]
    for name in options:
        if name not in INHERITED_OPTIONS:
            raise UnknownNameError(f"option of {env}", name, valid)
    known = {"reward_mode": BaseEnv.SUPPORTED_REWARD_MODES, "render_mode": RENDER_MODES}
    for name, modes in known.items():
        if options.get(name) not in (None, *modes):
            raise UnknownNameError(name, options[name], modes)
    if options.get("num_envs", 1) != 1:
        raise OptionError.of_value("num_envs", options["num_envs"], f"1. {ADVICE}")
    check_backend(options.get("sim_backend"))
    entries("sensor_configs", options.get("sensor_configs"))
    _check_obs_mode(options.get("obs_mode"))


def check_backend(sim_backend: str | None) -> None:
    """Raises OptionError for simulation on a GPU."""
    # A name may have a device, as in ``physx_cuda:0``.
    if (sim_backend or "auto").partition(":")[0] not in (*CPU_SIM_BACKENDS, "auto"):
        raise OptionError.of_value("sim_backend", sim_backend, f"'physx_cpu' or 'auto'. {ADVICE}")


def _check_obs_mode(obs_mode: Any) -> None:
    if obs_mode in (None, *BaseEnv.SUPPORTED_OBS_MODES):
        return
    try:
        parse_obs_mode_to_struct(obs_mode)
    except (AssertionError, AttributeError, TypeError) as error:
        raise OptionError.of_value("obs_mode", obs_mode, OBS_MODES) from error


WITHOUT_IMAGES = ("state", "state_dict", "none")
"""Observation modes without images."""

_RENDERED_ONLY = ("shader_pack", "shader_config", "use_stereo_depth")
"""Entries of `sensor_configs` that need a renderer."""


@dataclass(frozen=True, kw_only=True)
class ImageSource:
    """ManiSkill's render_backend, ``none`` without a graphics device, and whether rays are cast."""

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
    # ManiSkill's point clouds have colours where available.
    valid = _needs_renderer(obs_mode, options, (backend, obs_mode) != (RAYS, "pointcloud"))
    if backend == RAYS:
        if valid:
            raise OptionError.of_value("render_backend", backend, valid)
    elif backend != "auto" or not images or valid:
        return ImageSource(renderer=resolve_backend(backend, images or render_mode is not None))
    humans = render_mode not in (None, "sensors")
    return ImageSource(renderer=resolve_backend("auto", humans), casts_rays=images)


def _needs_renderer(obs_mode: str, options: Mapping[str, Any], colour: bool) -> str:
    """Returns what is valid where rays cannot compute the observed images, "" where they can."""
    configs = options.get("sensor_configs") or {}
    for config in (configs, *(c for c in configs.values() if isinstance(c, Mapping))):
        for name in _RENDERED_ONLY:
            if name in config:
                return f"'auto', 'cpu' or 'gpu' with {name!r} in sensor_configs"
    seen = parse_obs_mode_to_struct(obs_mode).visual
    if (seen.rgb and colour) or seen.normal or seen.albedo:
        return (
            f"'auto', 'cpu' or 'gpu' with obs_mode={obs_mode!r}, which needs a renderer; rays "
            "deliver depth, position and segmentation"
        )
    return ""
