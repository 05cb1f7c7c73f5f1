"""What is to be done in an episode, in a sentence for people."""

from __future__ import annotations

import inspect

from hab_tasks.episodes import Episode
from hab_tasks.figures.statistics import readable
from hab_tasks.skills.hab_env import HabEnv


def task_sentence(env: type[HabEnv]) -> str:
    """Returns what an environment is about: the first sentence of the class's docstring."""
    return " ".join((inspect.getdoc(env) or "").partition("\n\n")[0].split())


def instruction(env: type[HabEnv], episode: Episode) -> str:
    """Returns what is to be done, with the names of the episode's objects."""
    sentence = task_sentence(env)
    names = [readable(target.object.partition("_:")[0]).lower() for target in episode.targets]
    return f"{sentence.rstrip('.')}: {', '.join(names)}." if names else sentence
