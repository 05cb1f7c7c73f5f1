"""The Home Assistant Benchmark of Habitat 2.0 as a ManiSkill task pack.

Importing this package registers its environments and does nothing else. Then
``gym.make("HabPick-v1")`` works, as does ``gym.make("hab_tasks:HabPick-v1")`` without an import.
"""

from hab_tasks.envs import ENVS

__version__ = "0.1.0"
__all__ = ["ENVS", "__version__"]
