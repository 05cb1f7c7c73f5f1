"""Order of interactions derived from a task's declaration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from hab_tasks.receptacles import CONTAINERS
from hab_tasks.task_spec import Target, TaskSpec


@dataclass(frozen=True, kw_only=True)
class Interaction:
    """One skill of a task, other than navigation.

    Attributes:
        kind: The skill.
        target: Index of the target it is for.
        articulation: The door or drawer that the skill moves, or that encloses the target; None
            without one.
        stage: Name of the stage it completes (partial evaluation, S G.2).
    """

    kind: Literal["open", "pick", "place", "close"]
    target: int
    articulation: str | None
    stage: str


def interactions(spec: TaskSpec) -> tuple[Interaction, ...]:
    """Returns the interactions of a task in order (S H.3).

    Closed containers are opened with an empty hand, before the first target that needs them.
    """
    is_open = set(spec.starts_open)
    found: list[Interaction] = []
    for number, target in enumerate(spec.targets):
        for name in spec.containers_of(target):
            if name not in is_open:
                is_open.add(name)
                found.append(_moved("open", number, name))
        start, goal = (_behind(spec, names) for names in (target.start, spec.goal_of(target)))
        pick, place = target.stage_names
        found.append(Interaction(kind="pick", target=number, articulation=start, stage=pick))
        found.append(
            Interaction(kind="place", target=number, articulation=goal or start, stage=place)
        )
        found += [_moved("close", number, name) for name in _done_with(spec, number)]
    return tuple(found)


def _done_with(spec: TaskSpec, number: int) -> Iterator[str]:
    """Yields the containers to close after a target because no later target needs them."""
    later = {name for target in spec.targets[number + 1 :] for name in spec.containers_of(target)}
    last = number == len(spec.targets) - 1
    for name in spec.articulations:
        if name not in spec.ends_closed or name in later:
            continue
        users = [k for k, target in enumerate(spec.targets) if name in spec.containers_of(target)]
        if users[-1:] == [number] or (last and not users and name in spec.starts_open):
            yield name


def _moved(kind: Literal["open", "close"], number: int, name: str) -> Interaction:
    return Interaction(kind=kind, target=number, articulation=name, stage=f"{kind}_{name}")


def _behind(spec: TaskSpec, receptacles: tuple[str, ...]) -> str | None:
    """Returns the door or drawer that encloses the first of some receptacles."""
    found = (CONTAINERS.get(name) for name in receptacles)
    return next((name for name in found if name in spec.articulations), None)


def container_at_goal(spec: TaskSpec, target: Target) -> str | None:
    """Returns the door or drawer that encloses a target's goal; None for open receptacles."""
    return _behind(spec, spec.goal_of(target))


def container_at_start(spec: TaskSpec, target: Target) -> str | None:
    """Returns the door or drawer that encloses a target's start; None for open receptacles."""
    return _behind(spec, target.start)
