"""Declaration of a rearrangement task, and the order of interactions derived from it.

This module does not load the simulator, so packages that register tasks import quickly.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from operator import index
from typing import Any, Literal, NoReturn

from hab_tasks.errors import HabError, UnknownNameError, shown
from hab_tasks.object_names import ALL_OBJECTS, CATEGORIES
from hab_tasks.receptacles import CONTAINERS, ENCLOSED_RECEPTACLES, OPEN_RECEPTACLES, PHRASES

ARTICULATIONS = tuple(CONTAINERS.values())
"""The doors and drawers that the benchmark's skills open and close."""


def doors_and_drawers() -> tuple[str, ...]:
    """Returns the same with those of registered skills."""
    return tuple(dict.fromkeys(CONTAINERS.values()))


MOST_OBJECTS = 64
"""Maximum number of targets and clutter objects together; a layout has no room for more."""

LONGEST_STEPS = 1_000_000
LONGEST_NAME = 60
_ID = re.compile(r"(?!Hab-v)[A-Za-z]\w*-v(0|[1-9]\d{0,3})", re.ASCII)
_NAME = re.compile(r"[a-z][a-z0-9_]*")


class TaskSpecError(HabError):
    """Invalid task declaration. The message starts with the task's id."""


def _keep_tuples(declared: Any, *fields: str) -> None:
    """Replaces lists by tuples, so that declarations can be compared and looked up."""
    for field in fields:
        value = getattr(declared, field)
        if isinstance(value, list):
            object.__setattr__(declared, field, tuple(value))


def _given(value: object) -> str:
    """Formats a bad value as in Python, abbreviated to one line."""
    return shown(value) if type(value) is int else " ".join(reprlib.repr(value).split())


@dataclass(frozen=True, kw_only=True)
class Target:
    """An object to be rearranged.

    Attributes:
        name: Name in stages and plans: lower case, digits and underscores.
        start: Candidate start receptacles (`hab_tasks.receptacles`).
        goal: Candidate goal receptacles. Empty with `inside`.
        inside: Name of an earlier target; the object is put into it at that target's goal.
        objects: Candidate object or category names; empty for any object of the split
            (`hab_tasks.object_names`).
        stages: Stage names of its pick and place, instead of ``pick_name``, ``place_name``.
    """

    name: str
    start: tuple[str, ...]
    goal: tuple[str, ...] = ()
    inside: str | None = None
    objects: tuple[str, ...] = ()
    stages: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        """Takes lists for tuples; the task validates the rest."""
        _keep_tuples(self, "start", "goal", "objects", "stages")

    @property
    def stage_names(self) -> tuple[str, str]:
        """Stage names of its pick and its place."""
        return self.stages or (f"pick_{self.name}", f"place_{self.name}")

    @property
    def candidates(self) -> tuple[str, ...]:
        """Candidate objects; empty for any object of the split."""
        names = (name for known in self.objects for name in CATEGORIES.get(known, (known,)))
        return tuple(dict.fromkeys(names))


@dataclass(frozen=True, kw_only=True)
class TaskSpec:
    """A rearrangement task.

    Targets are moved in the order of `targets`. A door or drawer that starts closed is opened
    before the first target that needs it, and closed after the last one if listed in `ends_closed`.

    Attributes:
        id: Environment id, e.g. ``HabSetTable-v1``.
        instruction: The task in one sentence.
        targets: The objects to be rearranged, in order.
        horizon_steps: Maximum episode length.
        starts_open: Doors and drawers that start open; the others start closed.
        ends_closed: Doors and drawers that have to be closed at the end.
        clutter: Number of other objects.
        clutter_on: Receptacles for the clutter.

    Raises:
        TaskSpecError: The declaration is invalid.
        UnknownNameError: Unknown receptacle, object, door or drawer.
    """

    id: str
    instruction: str
    targets: tuple[Target, ...]
    horizon_steps: int
    starts_open: tuple[str, ...] = ()
    ends_closed: tuple[str, ...] = ()
    clutter: int = 25
    clutter_on: tuple[str, ...] = OPEN_RECEPTACLES

    def __post_init__(self) -> None:
        """Validates the declaration; takes lists for tuples."""
        known = isinstance(self.id, str) and len(self.id) <= LONGEST_NAME
        if not known or not _ID.fullmatch(self.id):
            raise TaskSpecError(
                f"Task id {_given(self.id)}: expected a name and a version, X-v1, "
                f"of at most {LONGEST_NAME} letters, digits and underscores."
            )
        _keep_tuples(self, "targets", "starts_open", "ends_closed", "clutter_on")
        self._check_targets()
        self._check_values()
        for field in ("starts_open", "ends_closed"):
            self._check_known(field, getattr(self, field), doors_and_drawers())
        self._check_receptacles("clutter_on", self.clutter_on)
        if self.clutter and not self.clutter_on:
            self._refuse("clutter_on names no receptacle for the clutter")
        for number, target in enumerate(self.targets):
            self._check_target(target, number)
        self._check_stages()

    @property
    def name(self) -> str:
        """The id in snake case, without ``Hab`` and version: ``set_table``."""
        words = self.id.rpartition("-v")[0].removeprefix("Hab")
        return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", words).lower()

    @property
    def class_name(self) -> str:
        """Name of the environment class: ``HabSetTableEnv``."""
        return f"{self.id.rpartition('-v')[0]}Env"

    @cached_property
    def articulations(self) -> tuple[str, ...]:
        """The doors and drawers that the task opens or closes, in order of first use."""
        used = dict.fromkeys(name for target in self.targets for name in self.containers_of(target))
        closed = (*used, *self.ends_closed)
        moved = (n for n in closed if n not in self.starts_open or n in self.ends_closed)
        return tuple(dict.fromkeys(moved))

    def goal_of(self, target: Target) -> tuple[str, ...]:
        """Returns the goal receptacles of a target, or of the target that it is put into."""
        while target.inside is not None:
            target = self.targets[self.number(target.inside)]
        return target.goal

    def containers_of(self, target: Target) -> tuple[str, ...]:
        """Returns the doors and drawers that may enclose a target at its start or goal."""
        found = (CONTAINERS.get(name) for name in (*target.start, *self.goal_of(target)))
        return tuple(dict.fromkeys(name for name in found if name is not None))

    def number(self, name: str) -> int:
        """Returns the index of a target by name."""
        return [target.name for target in self.targets].index(name)

    # Checks ----------------------------------------------------------------------------------

    def _check_targets(self) -> None:
        targets = self.targets
        if not isinstance(targets, tuple):
            self._refuse(f"targets is {_given(targets)}; a tuple of Target(...) is valid")
        for target in targets:
            if not isinstance(target, Target):
                self._refuse(f"targets has {_given(target)} in it; a tuple of Target(...) is valid")
        if not targets:
            self._refuse("no targets; a task needs at least one")
        if len(targets) > MOST_OBJECTS:
            self._refuse(f"{len(targets)} targets; from 1 to {MOST_OBJECTS} are valid")
        names = [self._checked_name("target name", target.name) for target in targets]
        self._check_different("targets", names)

    def _check_values(self) -> None:
        most = MOST_OBJECTS - len(self.targets)
        for field, low, high in (("clutter", 0, most), ("horizon_steps", 1, LONGEST_STEPS)):
            value = getattr(self, field)
            try:
                number = index(value)
            except TypeError:
                number = None
            if isinstance(value, bool) or number is None or not low <= number <= high:
                valid = f"whole numbers from {low} to {high} are valid"
                what = f", with {len(self.targets)} targets" if field == "clutter" else ""
                self._refuse(f"{field} is {_given(value)}; {valid}{what}")
            object.__setattr__(self, field, number)
        text = self.instruction
        if not isinstance(text, str) or not text.strip() or not text.isprintable():
            self._refuse(f"instruction is {_given(text)}; one line of text is valid")

    def _check_target(self, target: Target, number: int) -> None:
        where = f"target {target.name!r}"
        self._check_receptacles(f"start of {where}", target.start)
        self._check_receptacles(f"goal of {where}", target.goal)
        self._check_known(f"objects of {where}", target.objects, (*ALL_OBJECTS, *CATEGORIES))
        if not target.start:
            self._refuse(f"{where} has no receptacle to start on")
        if bool(target.goal) == (target.inside is not None):
            self._refuse(f"{where} needs either receptacles as its goal, or `inside`")
        earlier, inside = [other.name for other in self.targets[:number]], target.inside
        if inside is not None and not (isinstance(inside, str) and inside in earlier):
            itself = ", itself" if isinstance(inside, str) and inside == target.name else ""
            valid = ", ".join(earlier) or "none: it is the first"
            self._refuse(
                f"{where} is to be inside {_given(inside)}{itself}; "
                f"earlier targets are valid ({valid})"
            )

    def _check_stages(self) -> None:
        for target in self.targets:
            stages = target.stages
            if stages is not None and (not isinstance(stages, tuple) or len(stages) != 2):
                where = f"stages of target {target.name!r}"
                self._refuse(f"{where} is {_given(stages)}; None or two names are valid")
            for stage in stages or ():
                self._checked_name("stage", stage)
        named = [stage for target in self.targets for stage in target.stage_names]
        moved = [f"{verb}_{name}" for name in doors_and_drawers() for verb in ("open", "close")]
        self._check_different("stages", named + moved)

    def _checked_name(self, what: str, name: Any) -> str:
        if isinstance(name, str) and _NAME.fullmatch(name) and len(name) <= LONGEST_NAME:
            return name
        self._refuse(
            f"{what} {_given(name)}: use lower case, digits and underscores, at most {LONGEST_NAME}"
        )

    def _check_different(self, what: str, names: list[str]) -> None:
        for name in names:
            if names.count(name) > 1:
                self._refuse(f"two {what} are called {name!r}; each needs a name of its own")

    def _check_receptacles(self, field: str, names: Any) -> None:
        for name in names if isinstance(names, tuple) else ():
            if isinstance(name, str) and name in ENCLOSED_RECEPTACLES:
                self._refuse(
                    f"{field}: {name} is behind a door or in a drawer that no skill opens; "
                    f"of closed places, {' and '.join(CONTAINERS)} can be opened"
                )
        self._check_known(field, names, PHRASES)

    def _check_known(self, field: str, names: Any, valid: Collection[str]) -> None:
        kind = f"a tuple of names is valid, such as {tuple(valid)[:1]}"
        if not isinstance(names, tuple):
            self._refuse(f"{field} is {_given(names)}; {kind}")
        others = [name for name in names if not isinstance(name, str)]
        if others:
            self._refuse(f"{field} has {_given(others[0])} in it; {kind}")
        for name in names:
            if name not in valid:
                raise UnknownNameError(f"name in {field} of {self.id}", name, valid)
            if names.count(name) > 1:
                self._refuse(f"{field} names {name!r} twice; once is valid")

    def _refuse(self, reason: str) -> NoReturn:
        raise TaskSpecError(f"{self.id}: {reason}.")


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
        start, goal = (behind(spec, names) for names in (target.start, spec.goal_of(target)))
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


def behind(spec: TaskSpec, receptacles: tuple[str, ...]) -> str | None:
    """Returns the door or drawer that encloses the first of some receptacles."""
    found = (CONTAINERS.get(name) for name in receptacles)
    return next((name for name in found if name in spec.articulations), None)
