"""Declaration of a rearrangement task, from which everything else is derived.

This module does not load the simulator, so packages that register tasks import quickly.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

from hab_tasks.errors import HabError, UnknownNameError
from hab_tasks.object_names import ALL_OBJECTS, CATEGORIES
from hab_tasks.receptacles import CONTAINERS, ENCLOSED_RECEPTACLES, OPEN_RECEPTACLES, PHRASES

ARTICULATIONS = tuple(CONTAINERS.values())
"""The doors and drawers that the skills open and close."""

MOST_OBJECTS = 64
"""Maximum number of targets and clutter objects together; a layout has no room for more."""

LONGEST_STEPS = 1_000_000
_ID = re.compile(r"[A-Za-z]\w*-v\d+")
_NAME = re.compile(r"[a-z][a-z0-9_]*")


class TaskSpecError(HabError):
    """Invalid task declaration. The message starts with the task's id."""


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

    @property
    def stage_names(self) -> tuple[str, str]:
        """Stage names of its pick and its place."""
        return self.stages or (f"pick_{self.name}", f"place_{self.name}")

    @property
    def candidates(self) -> tuple[str, ...]:
        """Candidate objects; empty for any object of the split."""
        return tuple(name for known in self.objects for name in CATEGORIES.get(known, (known,)))


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
        """Validates the declaration."""
        self._check_names()
        self._check_numbers()
        for number, target in enumerate(self.targets):
            self._check_target(target, number)

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

    def _check_names(self) -> None:
        if not _ID.fullmatch(self.id):
            raise TaskSpecError(f"Task id {self.id!r}: expected a name and a version, X-v1.")
        names = [target.name for target in self.targets]
        for name in names:
            if not _NAME.fullmatch(name):
                self._refuse(f"target name {name!r}: use lower case, digits and underscores")
            if names.count(name) > 1:
                self._refuse(f"two targets are called {name!r}; each needs a name of its own")
        stages = [stage for target in self.targets for stage in target.stage_names]
        for stage in stages:
            if stages.count(stage) > 1:
                self._refuse(f"two stages are called {stage!r}; each needs a name of its own")
        for field in ("starts_open", "ends_closed"):
            self._check_known(field, getattr(self, field), ARTICULATIONS)
        self._check_receptacles("clutter_on", self.clutter_on)

    def _check_numbers(self) -> None:
        most = MOST_OBJECTS - len(self.targets)
        for field, low, high in (("clutter", 0, most), ("horizon_steps", 1, LONGEST_STEPS)):
            value = getattr(self, field)
            if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
                self._refuse(f"{field} is {value!r}; whole numbers from {low} to {high} are valid")
        if not self.targets:
            self._refuse("no targets; a task needs at least one")
        if self.clutter and not self.clutter_on:
            self._refuse("clutter_on names no receptacle for the clutter")

    def _check_target(self, target: Target, number: int) -> None:
        where = f"target {target.name!r}"
        self._check_receptacles(f"start of {where}", target.start)
        self._check_receptacles(f"goal of {where}", target.goal)
        self._check_known(f"objects of {where}", target.objects, (*ALL_OBJECTS, *CATEGORIES))
        if not target.start:
            self._refuse(f"{where} has no receptacle to start on")
        if bool(target.goal) == (target.inside is not None):
            self._refuse(f"{where} needs either receptacles as its goal, or `inside`")
        earlier = [other.name for other in self.targets[:number]]
        if target.inside is not None and target.inside not in earlier:
            itself = ", itself" if target.inside == target.name else ""
            valid = ", ".join(earlier) or "none: it is the first"
            self._refuse(
                f"{where} is to be inside {target.inside!r}{itself}; "
                f"earlier targets are valid ({valid})"
            )

    def _check_receptacles(self, field: str, names: tuple[str, ...]) -> None:
        for name in names:
            if name in ENCLOSED_RECEPTACLES:
                self._refuse(
                    f"{field}: {name} is behind a door or in a drawer that no skill opens; "
                    f"of closed places, {' and '.join(CONTAINERS)} can be opened"
                )
        self._check_known(field, names, PHRASES)

    def _check_known(self, field: str, names: tuple[str, ...], valid: Collection[str]) -> None:
        if isinstance(names, str):
            self._refuse(f"{field} is the text {names!r}; a tuple of names is valid")
        for name in names:
            if name not in valid:
                raise UnknownNameError(f"name in {field} of {self.id}", name, valid)

    def _refuse(self, reason: str) -> None:
        raise TaskSpecError(f"{self.id}: {reason}.")
