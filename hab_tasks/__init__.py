"""The Home Assistant Benchmark of Habitat 2.0 as a ManiSkill task pack.

Importing this package only registers its environments. Afterwards ``gym.make("HabPick-v1")``
works; ``gym.make("hab_tasks:HabPick-v1")`` works without the import.
"""

from typing import TYPE_CHECKING, Any

from hab_tasks.registration import register_skill, register_skills, register_task
from hab_tasks.task_spec import Target, TaskSpec
from hab_tasks.tasks.prepare_groceries import PREPARE_GROCERIES
from hab_tasks.tasks.set_table import SET_TABLE
from hab_tasks.tasks.tidy_house import TIDY_HOUSE

if TYPE_CHECKING:
    from hab_tasks.envs import ENVS

__version__ = "0.3.0"
__all__ = ["ENVS", "Target", "TaskSpec", "__version__", "register_skill", "register_task"]

register_skills()
for _spec in (TIDY_HOUSE, PREPARE_GROCERIES, SET_TABLE):
    register_task(_spec, __name__)


def __getattr__(name: str) -> Any:
    """Loads `ENVS`, and with it the simulator, on first access."""
    if name != "ENVS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from hab_tasks.envs import ENVS

    return ENVS
