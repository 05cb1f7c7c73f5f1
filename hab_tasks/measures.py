"""Named measures and the only mutable episode state.

`Measures` are computed from two consecutive snapshots; `Tracker` remembers what a single snapshot
cannot tell (accumulated force, previous distances, what was held before) and advances exactly once
for each control step. Measures are about one object, one door or drawer and one way: those of the
skill, or of the part of a task that is being done (`Focus`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, get_type_hints

from torch import Tensor

from hab_tasks.arrays import (
    Rows,
    angle_between,
    as_kind_of,
    norm,
    put_rows,
    rows_of,
    stack,
    to_tensor,
    where,
    whole,
    zeros,
)
from hab_tasks.constants import PLACE_RADIUS_M, REST_POSITION_M
from hab_tasks.goals import Goals
from hab_tasks.navigation.ways import Ways
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of one moment, (N,) each but the last two, with unit and meaning (`MEANINGS`).

    A ``_decrease`` is d_{t-1} - d_t (S C), 0 on the first moment; ``_now`` means in this step.
    """

    ee_to_object_m: Annotated[Rows, "m", "end-effector to the target's centre of mass"]
    ee_to_rest_m: Annotated[Rows, "m", "end-effector to its resting position, base frame"]
    object_to_goal_m: Annotated[Rows, "m", "target's centre of mass to its goal"]
    ee_to_handle_m: Annotated[Rows, "m", "end-effector to the handle"]
    ee_to_object_decrease_m: Annotated[Rows, "m", "decrease of ee_to_object_m"]
    ee_to_rest_decrease_m: Annotated[Rows, "m", "decrease of ee_to_rest_m"]
    object_to_goal_decrease_m: Annotated[Rows, "m", "decrease of object_to_goal_m"]
    ee_to_handle_decrease_m: Annotated[Rows, "m", "decrease of ee_to_handle_m"]
    holding_target: Annotated[Rows, "bool", "the target is in the hand"]
    holding_other: Annotated[Rows, "bool", "another object is in the hand"]
    holding_handle: Annotated[Rows, "bool", "the handle is in the hand"]
    picked_now: Annotated[Rows, "bool", "the target was grasped"]
    picked_other_now: Annotated[Rows, "bool", "another object was grasped"]
    dropped_now: Annotated[Rows, "bool", "the target left the hand"]
    placed: Annotated[Rows, "bool", "the target is within 0.15 m of its goal and not held"]
    placed_before: Annotated[Rows, "bool", "it was so at an earlier moment"]
    grabbed_now: Annotated[Rows, "bool", "the handle was grasped for the first time"]
    grabbed_before: Annotated[Rows, "bool", "the handle was grasped at an earlier moment"]
    joint: Annotated[Rows, "m or rad", "position of the door or drawer"]
    joint_share: Annotated[Rows, "1", "the same as a share of its travel"]
    joint_increase: Annotated[Rows, "m or rad", "how far it was opened in this step"]
    base_to_goal_m: Annotated[Rows, "m", "geodesic distance of the base to its goal"]
    base_to_goal_decrease_m: Annotated[Rows, "m", "decrease of base_to_goal_m"]
    heading_error_rad: Annotated[Rows, "rad", "between the base's heading and its goal's"]
    heading_error_decrease_rad: Annotated[Rows, "rad", "decrease of heading_error_rad"]
    stopped: Annotated[Rows, "bool", "the action was the stop action"]
    path_m: Annotated[Rows, "m", "way of the base since the episode began"]
    force_n: Annotated[Rows, "N", "contact force C_t on the robot, mean over the step"]
    force_total_n: Annotated[Rows, "N", "sum of C_t since the episode began"]
    steps: Annotated[Rows, "steps", "actions since the episode began"]
    ee_to_object_start_m: Annotated[Rows, "m", "ee_to_object_m when the episode began"]
    base_to_goal_start_m: Annotated[Rows, "m", "base_to_goal_m when the episode began"]
    ee_in_base_m: Annotated[Rows, "m", "(N, 3) end-effector in the base frame"]
    base_m: Annotated[Rows, "m", "(N, 2) the base in the world"]

    def scalars(self, names: tuple[str, ...]) -> dict[str, Rows]:
        """Returns the named measures, for `info`."""
        return {name: getattr(self, name) for name in names}


MEANINGS: dict[str, tuple[str, str]] = {
    name: hint.__metadata__ for name, hint in get_type_hints(Measures, include_extras=True).items()
}
"""Name of each measure -> its unit and its meaning."""


@dataclass(frozen=True, kw_only=True)
class Focus:
    """What the measures are about, (N,) each.

    Attributes:
        object: Number of the object among those to rearrange.
        front: Number of the door or drawer.
    """

    object: Rows
    front: Rows


class Tracker:
    """Advances `Measures` from snapshot to snapshot.

    Attributes:
        measures: The measures of the latest snapshot.
        targets: (N, K) index in the grasp of each object to rearrange.
        handles: (N, J) index in the grasp of each handle.
        goals: What the episodes ask for.
        focus: What the measures are about.
        ways: Distances of the base to where it has to be; None where nothing is navigated.
    """

    measures: Measures

    def __init__(self, goals: Goals, ways: Ways | None = None) -> None:
        """Makes a tracker for as many rows, objects and fronts as `goals` has."""
        count, objects, _ = goals.starts_m.shape
        fronts = goals.front.shape[1]
        self.goals, self.ways = goals, ways
        nothing = zeros(count, like=goals.base)
        never = nothing > 0
        integers = as_kind_of(list(range(count)), whole(nothing))
        self.targets = zeros(count, objects, like=integers)
        self.handles = zeros(count, fronts, like=integers)
        self.focus = Focus(object=integers * 0, front=integers * 0)
        self._rows = integers
        self._rest = as_kind_of(REST_POSITION_M, nothing)
        self._absent = {
            name: never if unit == "bool" else nothing for name, (unit, _) in MEANINGS.items()
        }
        self._started = False

    def begin(self, snapshot: Snapshot, rows: Tensor) -> None:
        """Starts the episodes in `rows` (R,) at `snapshot`; the other rows keep their state."""
        fresh = self._still(snapshot)
        fresh = replace(
            fresh,
            force_total_n=snapshot.force_n,
            ee_to_object_start_m=fresh.ee_to_object_m,
            base_to_goal_start_m=fresh.base_to_goal_m,
        )
        if not self._started:
            self.measures, self._started = fresh, True
        self.measures = select_rows(rows_of(self._rows, rows), fresh, self.measures)

    def refocus(self, snapshot: Snapshot, rows: Sequence[int] | Tensor, focus: Focus) -> None:
        """Turns `rows` (R,) to another object or front; `snapshot` is the latest one.

        What was counted since the episode began stays.
        """
        chosen = rows_of(self._rows, rows)
        self.focus = Focus(
            object=where(chosen, focus.object, self.focus.object),
            front=where(chosen, focus.front, self.focus.front),
        )
        last = self.measures
        kept = {name: getattr(last, name) for name in _SINCE_THE_START}
        self.measures = select_rows(chosen, replace(self._still(snapshot), **kept), last)

    def advance(self, snapshot: Snapshot, stopped: Rows) -> None:
        """Takes the next control step's snapshot, and whether its action was to stop (N,)."""
        last = self.measures
        values = self._absent | self._distances(snapshot, last)
        values["force_n"] = snapshot.force_n
        values["force_total_n"] = last.force_total_n + snapshot.force_n
        values["steps"] = last.steps + 1.0
        values["stopped"] = stopped
        values["ee_to_object_start_m"] = last.ee_to_object_start_m
        values["ee_in_base_m"], values["base_m"] = snapshot.ee_in_base_m, snapshot.base[:, :2]
        values |= self._object(snapshot, last, values)
        if self.handles.shape[1]:
            values |= self._front(snapshot, last)
        if self.ways is not None:
            values |= self._way(snapshot, last, self.ways)
        self.measures = Measures(**values)

    def get_state(self) -> dict[str, Tensor]:
        """Returns everything needed to go on from here, by name, (N, ...)."""
        state = {f.name: to_tensor(getattr(self.measures, f.name)) for f in fields(Measures)}
        others = {
            "focus_object": self.focus.object,
            "focus_front": self.focus.front,
            "targets": self.targets,
            "handles": self.handles,
        }
        return state | {name: to_tensor(value) for name, value in others.items()}

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores `rows` (R,) from what `get_state` returned for R rows."""
        names = [f.name for f in fields(Measures)]
        self.measures = Measures(
            **{n: put_rows(getattr(self.measures, n), rows, state[n]) for n in names}
        )
        self.focus = Focus(
            object=put_rows(self.focus.object, rows, state["focus_object"]),
            front=put_rows(self.focus.front, rows, state["focus_front"]),
        )
        self.targets = put_rows(self.targets, rows, state["targets"])
        self.handles = put_rows(self.handles, rows, state["handles"])

    def target(self) -> Rows:
        """Returns the index in the grasp (N,) of the object in focus."""
        return self._of(self.targets, self.focus.object)

    # One group of measures each ----------------------------------------------------------------

    def _still(self, s: Snapshot) -> Measures:
        """Measures of a snapshot that has no predecessor: nothing changes, totals are zero."""
        vectors = {"ee_in_base_m": s.ee_in_base_m, "base_m": s.base[:, :2]}
        blank = Measures(**self._absent | vectors)
        values = self._absent | vectors | self._distances(s, blank)
        values |= self._object(s, blank, values)
        if self.handles.shape[1]:
            values |= self._front(s, blank)
        if self.ways is not None:
            values |= self._way(s, blank, self.ways)
        values |= {name: self._absent[name] for name in _CHANGES}
        return Measures(**values | {"force_n": s.force_n})

    def _distances(self, s: Snapshot, last: Measures) -> dict[str, Rows]:
        """Distances of end-effector and object, and their decrease, in one operation each."""
        object_m = self._of(s.objects_m, self.focus.object)
        goal_m = self._of(self.goals.goals_m, self.focus.object)
        gaps = [object_m - s.ee_m, s.ee_in_base_m - self._rest, object_m - goal_m]
        names = _DISTANCES[:3]
        if self.handles.shape[1]:
            gaps.append(self._of(s.handles_m, self.focus.front) - s.ee_m)
            names = _DISTANCES
        now = norm(stack(gaps))
        values: dict[str, Rows] = dict(zip(names, now, strict=True))
        for name in names:
            values[_DECREASE[name]] = getattr(last, name) - values[name]
        return values

    def _object(self, s: Snapshot, last: Measures, now: dict[str, Rows]) -> dict[str, Rows]:
        """What happened to the target in the hand and at its goal."""
        holding = s.held == self.target()
        other = (s.held >= 0) & ~holding
        return {
            "holding_target": holding,
            "holding_other": other,
            "picked_now": holding & ~last.holding_target,
            "picked_other_now": other & ~last.holding_other,
            "dropped_now": last.holding_target & ~holding,
            "placed": (now["object_to_goal_m"] < PLACE_RADIUS_M) & ~holding,
            "placed_before": last.placed_before | last.placed,
        }

    def _front(self, s: Snapshot, last: Measures) -> dict[str, Rows]:
        """What happened to the handle, and how far it is open."""
        focus = self.focus.front
        joint = self._of(s.joints, focus)
        lower, upper = (
            self._of(self.goals.joint_lower, focus),
            self._of(self.goals.joint_upper, focus),
        )
        holding = s.held_handle == self._of(self.handles, focus)
        before: Rows = last.grabbed_before | last.holding_handle
        return {
            "holding_handle": holding,
            "grabbed_now": holding & ~before,
            "grabbed_before": before,
            "joint": joint,
            "joint_share": (joint - lower) / (upper - lower),
            "joint_increase": joint - last.joint,
        }

    def _way(self, s: Snapshot, last: Measures, ways: Ways) -> dict[str, Rows]:
        """How far the base still has to go and to turn."""
        distance_m = ways.distance_m(s.base[:, :2])
        error_rad = angle_between(s.base[:, 2], self.goals.base[:, 2])
        moved_m = norm(s.base[:, :2] - last.base_m)
        return {
            "base_to_goal_m": distance_m,
            "base_to_goal_decrease_m": last.base_to_goal_m - distance_m,
            "heading_error_rad": error_rad,
            "heading_error_decrease_rad": last.heading_error_rad - error_rad,
            "path_m": last.path_m + moved_m,
            "base_to_goal_start_m": last.base_to_goal_start_m,
        }

    def _of(self, values: Rows, column: Rows) -> Rows:
        """Returns the column (N,) of values (N, C, ...), (N, ...)."""
        if values.shape[1] == 1:
            return values[:, 0]
        if len(column) == 1:
            return values[:, int(column[0])]
        return values[self._rows, column]


_DISTANCES = ("ee_to_object_m", "ee_to_rest_m", "object_to_goal_m", "ee_to_handle_m")
_DECREASE = {name: f"{name.removesuffix('_m')}_decrease_m" for name in _DISTANCES}

_CHANGES = (
    *_DECREASE.values(),
    "base_to_goal_decrease_m",
    "heading_error_decrease_rad",
    "joint_increase",
    "picked_now",
    "picked_other_now",
    "dropped_now",
    "grabbed_now",
)
"""Measures of what happened in a step: nothing, on the first moment."""

_SINCE_THE_START = (
    "force_total_n",
    "steps",
    "path_m",
    "stopped",
    "ee_to_object_start_m",
    "base_to_goal_start_m",
)
"""Measures of the whole episode, whatever it is about now."""


def select_rows(chosen: Rows, new: Measures, old: Measures) -> Measures:
    """Returns `new` in the chosen rows (N,) and `old` elsewhere."""
    values = {}
    for f in fields(Measures):
        a, b = getattr(new, f.name), getattr(old, f.name)
        mask = chosen.reshape(-1, *([1] * (a.ndim - 1)))
        values[f.name] = where(mask, a, b)
    return Measures(**values)
