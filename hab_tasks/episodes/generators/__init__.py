"""Episode generators: settled, stable and reachable start states."""

from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module

from hab_tasks.episodes.generators.base import Generator, Made, Objects
from hab_tasks.episodes.generators.rearrange import Rearrange
from hab_tasks.registration import ENTRY_POINTS, TASKS
from hab_tasks.world.scenes.spec import SceneSpec

MakeGenerator = Callable[[Sequence[str], Callable[[str], SceneSpec], Objects], Generator]


def starts_of(env_id: str) -> type[Generator]:
    """Returns the generator class of a skill's start states."""
    module, _, name = ENTRY_POINTS[env_id].partition(":")
    return getattr(import_module(module), name).skill.starts


def generator_of(env_id: str) -> tuple[MakeGenerator, int]:
    """Returns the factory of an environment's generator, and the generator's version."""
    if env_id in TASKS:
        return partial(Rearrange, TASKS[env_id]), Rearrange.version
    starts = starts_of(env_id)
    return starts, starts.version


__all__ = ["Generator", "Made", "generator_of", "starts_of"]
