"""The Home Assistant Benchmark of Habitat 2.0 as a ManiSkill task pack.

Importing this package registers its environments and does nothing else. Then
``gym.make("HabPick-v1")`` works, as does ``gym.make("hab_tasks:HabPick-v1")`` without an import.
"""

from typing import TYPE_CHECKING, Any

from hab_tasks.registration import register_envs

if TYPE_CHECKING:
    from hab_tasks.envs import ENVS

__version__ = "0.1.0"
__all__ = ["ENVS", "__version__"]

register_envs()


def __getattr__(name: str) -> Any:
    """Loads `ENVS`, and with it the simulator, when somebody asks for it."""
    if name != "ENVS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from hab_tasks.envs import ENVS

    return ENVS
