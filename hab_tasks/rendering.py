"""Selection of the render device; only when images are requested."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import sapien
import torch
from mani_skill.render.shaders import ShaderConfig

from hab_tasks.errors import RenderingUnavailableError, UnknownNameError
from hab_tasks.simulator import PREBUILT_SHADER_CONFIGS, set_shader_pack

RAYS = "rays"
"""Depth on the CPU along each pixel's ray, without a renderer (`hab_tasks.world.raycast`)."""

BACKENDS = ("auto", "none", "cpu", "gpu", RAYS)

DEPTH_SHADER = "hab_depth"
"""ManiSkill shader pack with position and actor, no colour; half the time of ``minimal``."""

ADVICE = (
    "No Vulkan device can render images. Install a driver (Debian 12, as root: apt-get install -y "
    "-t bookworm-backports mesa-vulkan-drivers libvulkan1), or use obs_mode='state' or 'depth' "
    "without render_mode."
)


def resolve_backend(backend: str, wants_images: bool) -> str:
    """Returns ManiSkill's render_backend.

    Args:
        backend: ``auto`` renders only if images are requested, on an NVIDIA GPU with a Vulkan
            driver if there is one, else on the CPU; other names are passed through.
        wants_images: Whether observations or `render` need images.

    Raises:
        UnknownNameError: Unknown backend.
        RenderingUnavailableError: Images are requested, but there is no Vulkan device.
    """
    if str(backend).split(":")[0] not in (*BACKENDS, "cuda", "sapien_cpu", "sapien_cuda"):
        raise UnknownNameError("render_backend", backend, BACKENDS)
    if backend != "auto":
        return backend
    if not wants_images:
        return "none"
    if gpu_renders():
        return "gpu"
    if not software_vulkan_works():
        raise RenderingUnavailableError(ADVICE)
    return "cpu"


def sensor_shader(sensor_configs: dict[str, Any], backend: str, rgb: bool) -> dict[str, Any]:
    """Returns camera settings that use `DEPTH_SHADER` on CPU renderers if colour is not needed.

    An explicit shader of the caller is kept. `rgb`: more than depth, position and segmentation.
    """
    if backend != "cpu" or rgb or "shader_pack" in sensor_configs:
        return sensor_configs
    if DEPTH_SHADER not in PREBUILT_SHADER_CONFIGS:
        minimal = PREBUILT_SHADER_CONFIGS["minimal"]
        theirs, ours = "PositionSegmentation", "MillimetresSegmentation"
        # Formats are global, by texture name. ManiSkill switches the format of its own texture
        # between shader packs, so that a depth camera after a default one would read garbage.
        sapien.render.set_picture_format(ours, "r16g16b16a16sint")
        PREBUILT_SHADER_CONFIGS[DEPTH_SHADER] = ShaderConfig(
            shader_pack=str(Path(__file__).parent / "shaders" / "depth"),
            texture_names={ours: minimal.texture_names[theirs]},
            texture_transforms={ours: minimal.texture_transforms[theirs]},
        )
    return {**sensor_configs, "shader_pack": DEPTH_SHADER}


def use_default_shaders() -> None:
    """Resets the shaders for new cameras, so that they render colour as floats."""
    set_shader_pack(PREBUILT_SHADER_CONFIGS["default"])


@lru_cache(maxsize=1)
def gpu_renders() -> bool:
    """Returns whether there is an NVIDIA GPU on which SAPIEN can render."""
    if not torch.cuda.is_available():
        return False
    try:
        return sapien.Device("cuda").can_render()
    except RuntimeError:
        return False


def software_vulkan_works() -> bool:
    """Returns whether SAPIEN can create a CPU renderer."""
    return _kept_renderer() is not None


@lru_cache(maxsize=1)
def _kept_renderer() -> sapien.render.RenderSystem | None:
    """Keeps a renderer alive for the lifetime of the process; it renders nothing.

    SAPIEN discards its compiled shaders with its last renderer, and recompiling them takes four
    seconds on the CPU, which every environment created in sequence would pay.
    """
    try:
        return sapien.render.RenderSystem(sapien.Device("cpu"))
    except RuntimeError:
        return None
