"""Which device draws the images, found out only when images are asked for."""

from __future__ import annotations

from functools import lru_cache

import sapien
import torch

from hab_tasks.errors import RenderingUnavailableError, UnknownNameError

BACKENDS = ("auto", "none", "cpu", "gpu")

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
    if backend.split(":")[0] not in (*BACKENDS, "cuda", "sapien_cpu", "sapien_cuda"):
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


@lru_cache(maxsize=1)
def software_vulkan_works() -> bool:
    """Returns whether SAPIEN can make a renderer on the CPU."""
    try:
        sapien.render.RenderSystem(sapien.Device("cpu"))
    except RuntimeError:
        return False
    return True
