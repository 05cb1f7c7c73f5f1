"""Which device draws the images, found out only when images are asked for."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import sapien
import torch
from mani_skill.render.shaders import PREBUILT_SHADER_CONFIGS, ShaderConfig, set_shader_pack

from hab_tasks.errors import RenderingUnavailableError, UnknownNameError

BACKENDS = ("auto", "none", "cpu", "gpu")

DEPTH_SHADER = "hab_depth"
"""ManiSkill shader pack that draws position and actor, no colour: half the time of ``minimal``."""

ADVICE = (
    "No Vulkan device can draw images. Install a driver (Debian 12, as root: apt-get install -y -t "
    "bookworm-backports mesa-vulkan-drivers libvulkan1), or use obs_mode='state' without "
    "render_mode."
)


def resolve_backend(backend: str, wants_images: bool) -> str:
    """Returns ManiSkill's render_backend for ours.

    Args:
        backend: ``auto`` draws only when images are wanted, on an NVIDIA GPU where there is one and
            on the CPU elsewhere; any other name is taken as it is.
        wants_images: Whether observations or `render` need images.

    Raises:
        UnknownNameError: No such backend.
        RenderingUnavailableError: Images are wanted and no Vulkan device was found.
    """
    if str(backend).split(":")[0] not in (*BACKENDS, "cuda", "sapien_cpu", "sapien_cuda"):
        raise UnknownNameError("render_backend", backend, BACKENDS)
    if backend != "auto":
        return backend
    if not wants_images:
        return "none"
    if torch.cuda.is_available():
        return "gpu"
    if not software_vulkan_works():
        raise RenderingUnavailableError(ADVICE)
    return "cpu"


def sensor_shader(sensor_configs: dict[str, Any], backend: str, rgb: bool) -> dict[str, Any]:
    """Returns camera settings that use `DEPTH_SHADER` where no colour is asked of a CPU renderer.

    Args:
        sensor_configs: The caller's settings; a shader chosen there stays.
        backend: The resolved render backend.
        rgb: Whether observations hold anything but depth, position and segmentation.
    """
    if backend != "cpu" or rgb or "shader_pack" in sensor_configs:
        return sensor_configs
    if DEPTH_SHADER not in PREBUILT_SHADER_CONFIGS:
        minimal = PREBUILT_SHADER_CONFIGS["minimal"]
        texture = "PositionSegmentation"
        PREBUILT_SHADER_CONFIGS[DEPTH_SHADER] = ShaderConfig(
            shader_pack=str(Path(__file__).parent / "shaders" / "depth"),
            texture_names={texture: minimal.texture_names[texture]},
            texture_transforms={texture: minimal.texture_transforms[texture]},
        )
    return {**sensor_configs, "shader_pack": DEPTH_SHADER}


def use_default_shaders() -> None:
    """Cameras made from now on draw floats in colour, whatever the process has drawn before."""
    set_shader_pack(PREBUILT_SHADER_CONFIGS["default"])


def software_vulkan_works() -> bool:
    """Returns whether SAPIEN can make a renderer on the CPU."""
    return _kept_renderer() is not None


@lru_cache(maxsize=1)
def _kept_renderer() -> sapien.render.RenderSystem | None:
    """Draws nothing, and lives as long as the process.

    SAPIEN drops its compiled shaders with its last renderer, and compiling them anew takes the CPU
    four seconds: environments that are made one after another would each wait for that.
    """
    try:
        return sapien.render.RenderSystem(sapien.Device("cpu"))
    except RuntimeError:
        return None
