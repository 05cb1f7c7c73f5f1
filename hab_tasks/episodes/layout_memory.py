"""What the sandboxes of one generator compute once: collision bodies, free floor, receptacles.

Every entry is keyed by all that it depends on, poses bit by bit, so that it equals what it saves.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, TypeVar

from hab_tasks.io.cache import recalled
from hab_tasks.privileged import Array, CollisionBody
from hab_tasks.world.scenes.floor import BodyOutline, FreeFloor, body_outline, floor_of

T = TypeVar("T")

MOST_OUTLINES = 8192
MOST_FLOORS = 256
"""A floor takes 0.3 MB; it is made again from the outlines within milliseconds."""

MOST_FINDINGS = 1024

BodyState = tuple[int, bytes]
"""Identity of a collision body, and its pose."""


class LayoutMemory:
    """Data of layouts in one scene dataset, with one set of movable objects.

    Attributes:
        bodies: Collision bodies read from the engine, by pool key and body name.
    """

    def __init__(self) -> None:
        self.bodies: dict[Hashable, CollisionBody] = {}
        self._outlines: OrderedDict[Hashable, BodyOutline] = OrderedDict()
        self._floors: OrderedDict[Hashable, FreeFloor] = OrderedDict()
        self._findings: OrderedDict[Hashable, Any] = OrderedDict()

    def floor(self, bodies: Sequence[CollisionBody], world_from_body: Iterable[Array]) -> FreeFloor:
        """Returns the free floor between bodies at these poses (4, 4)."""
        poses = list(world_from_body)
        states = body_states(bodies, poses)

        def make() -> FreeFloor:
            placed = zip(states, bodies, poses, strict=True)
            return floor_of([self._outline(*one) for one in placed])

        return recalled(self._floors, states, make, MOST_FLOORS)

    def recall(self, key: Hashable, find: Callable[[], T]) -> T:
        """Returns what `find` found for this key before, or finds it."""
        return recalled(self._findings, key, find, MOST_FINDINGS)

    def _outline(
        self, state: BodyState, body: CollisionBody, world_from_body: Array
    ) -> BodyOutline:
        return recalled(
            self._outlines, state, lambda: body_outline(body, world_from_body), MOST_OUTLINES
        )


def body_states(
    bodies: Iterable[CollisionBody], world_from_body: Iterable[Array]
) -> tuple[BodyState, ...]:
    """Returns a key of bodies of `LayoutMemory.bodies`, which never drops any, and their poses."""
    placed = zip(bodies, world_from_body, strict=True)
    return tuple((id(body), pose.tobytes()) for body, pose in placed)
