"""Checks that this machine can simulate a batch, before ManiSkill starts."""

from __future__ import annotations

from functools import cache

import sapien
import torch
from mani_skill.envs.utils.system.backend import CPU_SIM_BACKENDS

from hab_tasks.errors import OptionError

ADVICE = "For several rows on the CPU, use gymnasium.make_vec('hab_tasks:HabPick-v1', num_envs=N)."


def check_rows(num_envs: int, sim_backend: str | None) -> None:
    """Rejects batch sizes that this machine cannot simulate.

    Args:
        num_envs: Batch size.
        sim_backend: ManiSkill's option; ``auto`` and None mean CPU for one row, GPU for more.

    Raises:
        OptionError: With the alternatives.
    """
    backend = (sim_backend or "auto").partition(":")[0]
    if backend in CPU_SIM_BACKENDS or (backend == "auto" and num_envs == 1):
        if num_envs != 1:
            raise OptionError.of_value("num_envs", num_envs, f"1 with {sim_backend=}. {ADVICE}")
        return
    if has_gpu():
        return
    reason = (
        "GPU simulation needs an NVIDIA GPU that torch can use, and PhysX's GPU library, which "
        f"SAPIEN downloads once. {ADVICE}"
    )
    if backend == "auto":
        raise OptionError.of_value("num_envs", num_envs, f"1 on this machine: {reason}")
    valid = f"'physx_cpu', with num_envs=1, on this machine: {reason}"
    raise OptionError.of_value("sim_backend", sim_backend, valid)


@cache
def has_gpu() -> bool:
    """Whether torch and SAPIEN find an NVIDIA GPU."""
    if not torch.cuda.is_available():
        return False
    try:
        sapien.Device("cuda")
    except RuntimeError:
        return False
    return True
