"""Native vector environments: many CPU simulations in few processes.

Attributes named as environment references are entry points of `gymnasium.make_vec`.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from hab_tasks.registration import MAIN
from hab_tasks.vector.vector_env import HabVectorEnv


def __getattr__(reference: str) -> Any:
    """Returns the function that makes the vector environment of ``module.X-v1``."""
    module, _, env_id = reference.rpartition(".")
    if not module or not env_id.partition("-v")[2].isdigit():
        raise AttributeError(f"module {__name__!r} has no attribute {reference!r}")
    return partial(HabVectorEnv, env_id if module == MAIN else f"{module}:{env_id}")
