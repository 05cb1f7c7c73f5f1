"""Natural-language instructions of episodes, for humans and language-conditioned policies."""

from __future__ import annotations

import re

from hab_tasks.episodes.schema import Episode, Rearrangement, ReceptacleRef, template_of
from hab_tasks.receptacles import PHRASES
from hab_tasks.task_spec import TaskSpec


def object_words(handle: str) -> str:
    """Returns an object's name in words: ``002_master_chef_can_:0000`` -> master chef can."""
    return re.sub(r"^\d{3}[_-]", "", template_of(handle)).replace("_", " ")


def skill_instruction(template: str, episode: Episode) -> str:
    """Returns the instruction of a skill's episode.

    The template has ``{object}``, ``{start}`` (from the sofa) or ``{goal}`` (on the sofa).
    """
    if not episode.targets:
        return template
    target = episode.targets[0]
    return template.format(
        object=object_words(target.object), start=_source(target.start), goal=_phrase(target.goal)
    ).replace(" .", ".")


def task_instruction(spec: TaskSpec, episode: Episode) -> str:
    """Returns the instruction of a task's episode, in the order of its interactions."""
    done = [_moving(spec, number, episode.targets) for number in range(len(episode.targets))]
    if spec.ends_closed:
        done.append(f"close the {' and the '.join(spec.ends_closed)}")
    sentence = ", then ".join(done)
    return f"{sentence[:1].upper()}{sentence[1:]}."


def navigation_instruction(episode: Episode) -> str:
    """Returns the instruction of a Navigate episode: the object to be reached at the goal."""
    if episode.handle is not None:
        name = "fridge" if episode.handle.furniture.startswith("fridge") else "drawer"
        return f"Drive to the {name}."
    target = episode.targets[0]
    name = object_words(target.object)
    if episode.held is not None:
        return f"Drive to where the {name} is to be put {_phrase(target.goal)}.".replace(" .", ".")
    return f"Drive to the {name} {_phrase(target.start)}.".replace(" .", ".")


def _moving(spec: TaskSpec, number: int, targets: tuple[Rearrangement, ...]) -> str:
    target, inside = targets[number], spec.targets[number].inside
    goal = _phrase(target.goal)
    if inside is not None:
        goal = f"into the {object_words(targets[spec.number(inside)].object)}"
    words = ("put the", object_words(target.object), _source(target.start), goal)
    return " ".join(word for word in words if word)


def _phrase(ref: ReceptacleRef | None) -> str:
    """Returns ``on the sofa``; empty for a receptacle without a name in words."""
    return "" if ref is None else PHRASES.get(ref[0], "")


def _source(ref: ReceptacleRef | None) -> str:
    """Returns ``from the sofa``."""
    phrase = _phrase(ref)
    return f"from {phrase.partition(' ')[2]}" if phrase else ""
