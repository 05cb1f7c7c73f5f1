"""Named measures, and the only mutable state of an episode.

`Measures` are computed from two consecutive snapshots. `Tracker` keeps the history (accumulated
force, previous distances, earlier grasps) and advances exactly once per control step. Measures
refer to one object, one door or drawer and one navigation goal: those of the skill, or of the
current part of a task (`Focus`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, get_type_hints

import torch
from torch import Tensor

from hab_tasks.arrays import (
    BatchArray,
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
from hab_tasks.constants import (
    CONTROL_HZ,
    PLACE_RADIUS_M,
    REST_POSITION_M,
    REST_SPEED_M_S,
    REST_STEPS,
)
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.navigation.geodesic import GeodesicDistances

REST_STEP_M = REST_SPEED_M_S / CONTROL_HZ
"""Distance moved in one control step below which an object is at rest."""


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of one step, (N,) each except the last two, with unit and meaning (`MEANINGS`).

    A ``_decrease`` is d_{t-1} - d_t (S C), 0 in the first step; ``_now`` means in this step.
    """

    ee_to_object_m: Annotated[BatchArray, "m", "end-effector to the target's centre of mass"]
    ee_to_rest_m: Annotated[BatchArray, "m", "end-effector to its resting position, base frame"]
    object_to_goal_m: Annotated[BatchArray, "m", "target's centre of mass to its goal"]
    ee_to_handle_m: Annotated[BatchArray, "m", "end-effector to the handle"]
    ee_to_object_decrease_m: Annotated[BatchArray, "m", "decrease of ee_to_object_m"]
    ee_to_rest_decrease_m: Annotated[BatchArray, "m", "decrease of ee_to_rest_m"]
    object_to_goal_decrease_m: Annotated[BatchArray, "m", "decrease of object_to_goal_m"]
    ee_to_handle_decrease_m: Annotated[BatchArray, "m", "decrease of ee_to_handle_m"]
    holding_target: Annotated[BatchArray, "bool", "the gripper holds the target"]
    holding_other: Annotated[BatchArray, "bool", "the gripper holds another object"]
    holding_handle: Annotated[BatchArray, "bool", "the gripper holds the handle"]
    picked_now: Annotated[BatchArray, "bool", "the target was grasped"]
    picked_other_now: Annotated[BatchArray, "bool", "another object was grasped"]
    dropped_now: Annotated[BatchArray, "bool", "the target left the hand"]
    ee_to_rest_gain_m: Annotated[
        BatchArray, "m", "decrease of ee_to_rest_m from the latest grasp or release up to this step"
    ]
    object_to_goal_gain_m: Annotated[BatchArray, "m", "the same of object_to_goal_m"]
    released: Annotated[BatchArray, "bool", "the target is within 0.15 m of its goal and not held"]
    released_before: Annotated[BatchArray, "bool", "the target was released at an earlier step"]
    placed: Annotated[BatchArray, "bool", "the target is released and at rest"]
    placed_before: Annotated[BatchArray, "bool", "the target was placed at an earlier step"]
    grabbed_now: Annotated[BatchArray, "bool", "the handle was grasped for the first time"]
    grabbed_before: Annotated[BatchArray, "bool", "the handle was grasped at an earlier step"]
    joint: Annotated[BatchArray, "m or rad", "position of the door or drawer"]
    joint_share: Annotated[BatchArray, "1", "joint as a share of its travel"]
    joint_increase: Annotated[BatchArray, "m or rad", "increase of joint in this step"]
    base_to_goal_m: Annotated[BatchArray, "m", "geodesic distance of the base to its goal"]
    base_to_goal_decrease_m: Annotated[BatchArray, "m", "decrease of base_to_goal_m"]
    heading_error_rad: Annotated[BatchArray, "rad", "between the base's heading and its goal's"]
    heading_error_decrease_rad: Annotated[BatchArray, "rad", "decrease of heading_error_rad"]
    stopped: Annotated[BatchArray, "bool", "the action was the stop action"]
    path_m: Annotated[BatchArray, "m", "length of the base's path since the episode began"]
    force_n: Annotated[BatchArray, "N", "contact force C_t on the robot, mean over the step"]
    force_total_n: Annotated[BatchArray, "N", "sum of C_t since the episode began"]
    steps: Annotated[BatchArray, "steps", "actions since the episode began"]
    ee_to_object_start_m: Annotated[BatchArray, "m", "ee_to_object_m when the episode began"]
    base_to_goal_start_m: Annotated[BatchArray, "m", "base_to_goal_m when the episode began"]
    ee_in_base_m: Annotated[BatchArray, "m", "(N, 3) end-effector in the base frame"]
    base_m: Annotated[BatchArray, "m", "(N, 2) the base in the world"]

    def scalars(self, names: tuple[str, ...]) -> dict[str, BatchArray]:
        """Returns the named measures, for `info`."""
        return {name: getattr(self, name) for name in names}


MEANINGS: dict[str, tuple[str, str]] = {
    name: hint.__metadata__ for name, hint in get_type_hints(Measures, include_extras=True).items()
}
"""Measure name -> (unit, meaning)."""


@dataclass(frozen=True, kw_only=True)
class Focus:
    """Object and door or drawer that the measures refer to, (N,) each.

    Attributes:
        object: Index among the objects to rearrange.
        articulation: Number of the door or drawer.
    """

    object: BatchArray
    articulation: BatchArray


class Tracker:
    """Advances `Measures` from snapshot to snapshot.

    Attributes:
        measures: The measures of the latest snapshot.
        targets: (N, K) grasp index of each object to rearrange.
        handles: (N, J) grasp index of each handle.
        still_steps: (N, K) for how many steps each object has been slow and not held.
        goals: Goals of the episodes.
        focus: Object and door or drawer that the measures refer to.
        geodesic: Geodesic distances of the base to its goal; None without navigation.
    """

    def __init__(self, goals: Goals, geodesic: GeodesicDistances | None = None) -> None:
        """Creates a tracker with the rows, objects and articulations of `goals`."""
        count, objects, _ = goals.starts_m.shape
        articulations = goals.articulation_frame.shape[1]
        self.goals, self.geodesic = goals, geodesic
        nothing = zeros(count, like=goals.base)
        never = nothing > 0
        integers = as_kind_of(list(range(count)), whole(nothing))
        self.targets = zeros(count, objects, like=integers)
        self.handles = zeros(count, articulations, like=integers)
        self.still_steps = zeros(count, objects, like=nothing)
        self._objects_m = goals.starts_m
        self.focus = Focus(object=integers * 0, articulation=integers * 0)
        self._rows = integers
        self._rest = as_kind_of(REST_POSITION_M, nothing)
        self._absent = {
            name: never if unit == "bool" else nothing for name, (unit, _) in MEANINGS.items()
        }
        vectors = {
            "ee_in_base_m": zeros(count, 3, like=nothing),
            "base_m": zeros(count, 2, like=nothing),
        }
        self.measures = Measures(**self._absent | vectors)

    def begin(self, snapshot: Snapshot, rows: Tensor) -> None:
        """Starts the episodes in `rows` (R,) at `snapshot`; the other rows keep their state."""
        chosen = rows_of(self._rows, rows)
        held = snapshot.held[:, None] == self.targets
        still = where(held, self.still_steps * 0.0, self.still_steps * 0.0 + REST_STEPS)
        self.still_steps = where(chosen[:, None], still, self.still_steps)
        self._objects_m = where(chosen[:, None, None], snapshot.objects_m, self._objects_m)
        fresh = self._still(snapshot)
        fresh = replace(
            fresh,
            force_total_n=snapshot.force_n,
            ee_to_object_start_m=fresh.ee_to_object_m,
            base_to_goal_start_m=fresh.base_to_goal_m,
        )
        self.measures = select_rows(chosen, fresh, self.measures)

    def refocus(self, snapshot: Snapshot, rows: Sequence[int] | Tensor, focus: Focus) -> None:
        """Sets the focus of `rows` (R,); `snapshot` is the latest one.

        Totals since the episode began are kept.
        """
        chosen = rows_of(self._rows, rows)
        self.focus = Focus(
            object=where(chosen, focus.object, self.focus.object),
            articulation=where(chosen, focus.articulation, self.focus.articulation),
        )
        last = self.measures
        kept = {name: getattr(last, name) for name in _SINCE_THE_START}
        self.measures = select_rows(chosen, replace(self._still(snapshot), **kept), last)

    def advance(self, snapshot: Snapshot, stopped: BatchArray) -> None:
        """Advances by one control step.

        Args:
            snapshot: Snapshot after the step.
            stopped: (N,) whether the action was the stop action.
        """
        last = self.measures
        self._watch_objects(snapshot)
        values = self._absent | self._distances(snapshot, last)
        values["force_n"] = snapshot.force_n
        values["force_total_n"] = last.force_total_n + snapshot.force_n
        values["steps"] = last.steps + 1.0
        values["stopped"] = stopped
        values["ee_to_object_start_m"] = last.ee_to_object_start_m
        values["ee_in_base_m"], values["base_m"] = snapshot.ee_in_base_m, snapshot.base[:, :2]
        values |= self._object(snapshot, last, values)
        if self.handles.shape[1]:
            values |= self._articulation(snapshot, last)
        if self.geodesic is not None:
            values |= self._navigation(snapshot, last, self.geodesic)
        self.measures = Measures(**values)

    def get_state(self) -> dict[str, Tensor]:
        """Returns the complete state by name, (N, ...)."""
        state = {f.name: to_tensor(getattr(self.measures, f.name)) for f in fields(Measures)}
        others = {
            "focus_object": self.focus.object,
            "focus_articulation": self.focus.articulation,
            "targets": self.targets,
            "handles": self.handles,
            "still_steps": self.still_steps,
            "objects_m": self._objects_m,
        }
        return state | {name: to_tensor(value) for name, value in others.items()}

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores `rows` (R,) from a state of R rows."""
        names = [f.name for f in fields(Measures)]
        self.measures = Measures(
            **{n: put_rows(getattr(self.measures, n), rows, state[n]) for n in names}
        )
        self.focus = Focus(
            object=put_rows(self.focus.object, rows, state["focus_object"]),
            articulation=put_rows(self.focus.articulation, rows, state["focus_articulation"]),
        )
        self.targets = put_rows(self.targets, rows, state["targets"])
        self.handles = put_rows(self.handles, rows, state["handles"])
        self.still_steps = put_rows(self.still_steps, rows, state["still_steps"])
        self._objects_m = put_rows(self._objects_m, rows, state["objects_m"])

    def copy_row(self, row: int, other: Tracker) -> None:
        """Copies a tracker of one row, with its goals, to `row`."""
        self.set_state(other.get_state(), torch.tensor([row]))
        self.goals = self.goals.changed([row], other.goals.state())
        if self.geodesic is not None and other.geodesic is not None:
            self.geodesic.copy_row(row, other.geodesic)

    def at_rest(self) -> BatchArray:
        """Returns which objects (N, K) have been at rest since they left the hand."""
        return self.still_steps >= REST_STEPS

    def target(self) -> BatchArray:
        """Returns the grasp index (N,) of the object in focus."""
        return self._of(self.targets, self.focus.object)

    def _watch_objects(self, s: Snapshot) -> None:
        """Counts the steps for which each object has been slow and not held."""
        slow = norm(s.objects_m - self._objects_m) < REST_STEP_M
        self.still_steps = (self.still_steps + 1.0) * (slow & (s.held[:, None] != self.targets))
        self._objects_m = s.objects_m

    # One group of measures each ----------------------------------------------------------------

    def _still(self, s: Snapshot) -> Measures:
        """Measures of the first snapshot: no changes, totals are zero."""
        vectors = {"ee_in_base_m": s.ee_in_base_m, "base_m": s.base[:, :2]}
        blank = Measures(**self._absent | vectors)
        values = self._absent | vectors | self._distances(s, blank)
        values |= self._object(s, blank, values)
        if self.handles.shape[1]:
            values |= self._articulation(s, blank)
        if self.geodesic is not None:
            values |= self._navigation(s, blank, self.geodesic)
        values |= {name: self._absent[name] for name in _CHANGES}
        return Measures(**values | {"force_n": s.force_n})

    def _distances(self, s: Snapshot, last: Measures) -> dict[str, BatchArray]:
        """Distances of end-effector and object, and their decreases, vectorised."""
        object_m = self._of(s.objects_m, self.focus.object)
        goal_m = self._of(self.goals.goals_m, self.focus.object)
        gaps = [object_m - s.ee_m, s.ee_in_base_m - self._rest, object_m - goal_m]
        names = _DISTANCES[:3]
        if self.handles.shape[1]:
            gaps.append(self._of(s.handles_m, self.focus.articulation) - s.ee_m)
            names = _DISTANCES
        now = norm(stack(gaps))
        values: dict[str, BatchArray] = dict(zip(names, now, strict=True))
        for name in names:
            values[_DECREASE[name]] = getattr(last, name) - values[name]
        return values

    def _object(
        self, s: Snapshot, last: Measures, now: dict[str, BatchArray]
    ) -> dict[str, BatchArray]:
        """Grasp and placement of the target."""
        holding = s.held == self.target()
        other = (s.held >= 0) & ~holding
        released = (now["object_to_goal_m"] < PLACE_RADIUS_M) & ~holding
        kept = ~(last.picked_now | last.dropped_now)  # gains since the last of these
        return {
            "holding_target": holding,
            "holding_other": other,
            "picked_now": holding & ~last.holding_target,
            "picked_other_now": other & ~last.holding_other,
            "dropped_now": last.holding_target & ~holding,
            "ee_to_rest_gain_m": last.ee_to_rest_gain_m * kept + last.ee_to_rest_decrease_m,
            "object_to_goal_gain_m": last.object_to_goal_gain_m * kept
            + last.object_to_goal_decrease_m,
            "released": released,
            "released_before": last.released_before | last.released,
            "placed": released & (self._of(self.still_steps, self.focus.object) >= REST_STEPS),
            "placed_before": last.placed_before | last.placed,
        }

    def _articulation(self, s: Snapshot, last: Measures) -> dict[str, BatchArray]:
        """Grasp of the handle, and joint position."""
        focus = self.focus.articulation
        joint = self._of(s.joints, focus)
        lower, upper = (
            self._of(self.goals.joint_lower, focus),
            self._of(self.goals.joint_upper, focus),
        )
        holding = s.held_handle == self._of(self.handles, focus)
        before: BatchArray = last.grabbed_before | last.holding_handle
        return {
            "holding_handle": holding,
            "grabbed_now": holding & ~before,
            "grabbed_before": before,
            "joint": joint,
            "joint_share": (joint - lower) / (upper - lower),
            "joint_increase": joint - last.joint,
        }

    def _navigation(
        self, s: Snapshot, last: Measures, geodesic: GeodesicDistances
    ) -> dict[str, BatchArray]:
        """Distance and heading error of the base to its goal."""
        distance_m = geodesic.distance_m(s.base[:, :2])
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

    def _of(self, values: BatchArray, column: BatchArray) -> BatchArray:
        """Returns values (N, C, ...) at the column (N,) of each row, (N, ...)."""
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
"""Measures of changes within a step; zero in the first step."""

_SINCE_THE_START = (
    "force_total_n",
    "steps",
    "path_m",
    "stopped",
    "ee_to_object_start_m",
    "base_to_goal_start_m",
)
"""Measures of the whole episode, independent of the focus."""


def select_rows(chosen: BatchArray, new: Measures, old: Measures) -> Measures:
    """Returns `new` in the chosen rows (N,) and `old` in the others."""
    values = {}
    for f in fields(Measures):
        a, b = getattr(new, f.name), getattr(old, f.name)
        mask = chosen.reshape(-1, *([1] * (a.ndim - 1)))
        values[f.name] = where(mask, a, b)
    return Measures(**values)
