"""Named measures and the only mutable episode state.

`Measures` are computed from two consecutive snapshots; `Tracker` remembers what a single snapshot
cannot tell (accumulated force, previous distances, what was held before) and advances exactly once
for each control step. Measures are about one object, one door or drawer and one way: those of the
skill, or of the part of a task that is being done (`Focus`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Annotated, get_type_hints

import torch
from torch import Tensor

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.goals import Goals
from hab_tasks.navigation.ways import Ways
from hab_tasks.snapshot import Snapshot

PLACE_RADIUS_M = 0.15
"""An object is at its goal within this distance, whatever its orientation (S G.1)."""


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of one moment, (N,) each but the last two, with unit and meaning (`MEANINGS`).

    A ``_decrease`` is d_{t-1} - d_t (S C), 0 on the first moment; ``_now`` means in this step.
    """

    ee_to_object_m: Annotated[Tensor, "m", "end-effector to the target's centre of mass"]
    ee_to_rest_m: Annotated[Tensor, "m", "end-effector to its resting position, base frame"]
    object_to_goal_m: Annotated[Tensor, "m", "target's centre of mass to its goal"]
    ee_to_handle_m: Annotated[Tensor, "m", "end-effector to the handle"]
    ee_to_object_decrease_m: Annotated[Tensor, "m", "decrease of ee_to_object_m"]
    ee_to_rest_decrease_m: Annotated[Tensor, "m", "decrease of ee_to_rest_m"]
    object_to_goal_decrease_m: Annotated[Tensor, "m", "decrease of object_to_goal_m"]
    ee_to_handle_decrease_m: Annotated[Tensor, "m", "decrease of ee_to_handle_m"]
    holding_target: Annotated[Tensor, "bool", "the target is in the hand"]
    holding_other: Annotated[Tensor, "bool", "another object is in the hand"]
    holding_handle: Annotated[Tensor, "bool", "the handle is in the hand"]
    picked_now: Annotated[Tensor, "bool", "the target was grasped"]
    picked_other_now: Annotated[Tensor, "bool", "another object was grasped"]
    dropped_now: Annotated[Tensor, "bool", "the target left the hand"]
    placed: Annotated[Tensor, "bool", "the target is within 0.15 m of its goal and not held"]
    placed_before: Annotated[Tensor, "bool", "it was so at an earlier moment"]
    grabbed_now: Annotated[Tensor, "bool", "the handle was grasped for the first time"]
    grabbed_before: Annotated[Tensor, "bool", "the handle was grasped at an earlier moment"]
    joint: Annotated[Tensor, "m or rad", "position of the door or drawer"]
    joint_share: Annotated[Tensor, "1", "the same as a share of its travel"]
    joint_increase: Annotated[Tensor, "m or rad", "how far it was opened in this step"]
    base_to_goal_m: Annotated[Tensor, "m", "geodesic distance of the base to its goal"]
    base_to_goal_decrease_m: Annotated[Tensor, "m", "decrease of base_to_goal_m"]
    heading_error_rad: Annotated[Tensor, "rad", "between the base's heading and its goal's"]
    heading_error_decrease_rad: Annotated[Tensor, "rad", "decrease of heading_error_rad"]
    stopped: Annotated[Tensor, "bool", "the action was the stop action"]
    path_m: Annotated[Tensor, "m", "way of the base since the episode began"]
    force_n: Annotated[Tensor, "N", "contact force C_t on the robot, mean over the step"]
    force_total_n: Annotated[Tensor, "N", "sum of C_t since the episode began"]
    steps: Annotated[Tensor, "steps", "actions since the episode began"]
    ee_to_object_start_m: Annotated[Tensor, "m", "ee_to_object_m when the episode began"]
    base_to_goal_start_m: Annotated[Tensor, "m", "base_to_goal_m when the episode began"]
    ee_in_base_m: Annotated[Tensor, "m", "(N, 3) end-effector in the base frame"]
    base_m: Annotated[Tensor, "m", "(N, 2) the base in the world"]

    def scalars(self, names: tuple[str, ...]) -> dict[str, Tensor]:
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

    object: Tensor
    front: Tensor


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
        fronts, device = goals.front.shape[1], goals.front.device
        self.goals, self.ways = goals, ways
        self.targets = torch.zeros(count, objects, dtype=torch.long, device=device)
        self.handles = torch.zeros(count, fronts, dtype=torch.long, device=device)
        none = torch.zeros(count, dtype=torch.long, device=device)
        self.focus = Focus(object=none, front=none)
        self._rows = torch.arange(count, device=device)
        self._rest = torch.tensor(REST_POSITION_M, device=device)
        zeros, never = torch.zeros(count, device=device), torch.zeros(count, device=device) > 0
        self._absent = {
            name: never if unit == "bool" else zeros for name, (unit, _) in MEANINGS.items()
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
        self.measures = select_rows(self._chosen(rows), fresh, self.measures)

    def refocus(self, snapshot: Snapshot, rows: Tensor, focus: Focus) -> None:
        """Turns `rows` (R,) to another object or front; `snapshot` is the latest one.

        What was counted since the episode began stays.
        """
        chosen = self._chosen(rows)
        self.focus = Focus(
            object=torch.where(chosen, focus.object, self.focus.object),
            front=torch.where(chosen, focus.front, self.focus.front),
        )
        last = self.measures
        kept = {name: getattr(last, name) for name in _SINCE_THE_START}
        self.measures = select_rows(chosen, replace(self._still(snapshot), **kept), last)

    def advance(self, snapshot: Snapshot, stopped: Tensor) -> None:
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
        state = {f.name: getattr(self.measures, f.name).clone() for f in fields(Measures)}
        focus = {"focus_object": self.focus.object.clone(), "focus_front": self.focus.front.clone()}
        return {**state, **focus, "targets": self.targets.clone(), "handles": self.handles.clone()}

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores `rows` (R,) from what `get_state` returned for R rows."""

        def merged(old: Tensor, name: str) -> Tensor:
            value = old.clone()
            value[rows] = state[name].to(value.dtype)
            return value

        self.measures = Measures(
            **{f.name: merged(getattr(self.measures, f.name), f.name) for f in fields(Measures)}
        )
        self.focus = Focus(
            object=merged(self.focus.object, "focus_object"),
            front=merged(self.focus.front, "focus_front"),
        )
        self.targets = merged(self.targets, "targets")
        self.handles = merged(self.handles, "handles")

    def target(self) -> Tensor:
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

    def _distances(self, s: Snapshot, last: Measures) -> dict[str, Tensor]:
        """Distances of end-effector and object, and their decrease, in one operation each."""
        object_m = self._of(s.objects_m, self.focus.object)
        goal_m = self._of(self.goals.goals_m, self.focus.object)
        gaps = [object_m - s.ee_m, s.ee_in_base_m - self._rest, object_m - goal_m]
        names = _DISTANCES[:3]
        if self.handles.shape[1]:
            gaps.append(self._of(s.handles_m, self.focus.front) - s.ee_m)
            names = _DISTANCES
        before = torch.stack([getattr(last, f"{name}_m") for name in names])
        now = torch.linalg.vector_norm(torch.stack(gaps), dim=2)
        values = dict(zip((f"{name}_m" for name in names), now.unbind(), strict=True))
        decreases = (before - now).unbind()
        values |= zip((f"{name}_decrease_m" for name in names), decreases, strict=True)
        return values

    def _object(self, s: Snapshot, last: Measures, now: dict[str, Tensor]) -> dict[str, Tensor]:
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

    def _front(self, s: Snapshot, last: Measures) -> dict[str, Tensor]:
        """What happened to the handle, and how far it is open."""
        focus = self.focus.front
        joint = self._of(s.joints, focus)
        lower, upper = (
            self._of(self.goals.joint_lower, focus),
            self._of(self.goals.joint_upper, focus),
        )
        holding = s.held_handle == self._of(self.handles, focus)
        before = last.grabbed_before | last.holding_handle
        return {
            "holding_handle": holding,
            "grabbed_now": holding & ~before,
            "grabbed_before": before,
            "joint": joint,
            "joint_share": (joint - lower) / (upper - lower),
            "joint_increase": joint - last.joint,
        }

    def _way(self, s: Snapshot, last: Measures, ways: Ways) -> dict[str, Tensor]:
        """How far the base still has to go and to turn."""
        distance_m = ways.distance_m(s.base[:, :2])
        turn = s.base[:, 2] - self.goals.base[:, 2]
        error_rad = torch.atan2(torch.sin(turn), torch.cos(turn)).abs()
        moved_m = torch.linalg.vector_norm(s.base[:, :2] - last.base_m, dim=1)
        return {
            "base_to_goal_m": distance_m,
            "base_to_goal_decrease_m": last.base_to_goal_m - distance_m,
            "heading_error_rad": error_rad,
            "heading_error_decrease_rad": last.heading_error_rad - error_rad,
            "path_m": last.path_m + moved_m,
            "base_to_goal_start_m": last.base_to_goal_start_m,
        }

    def _of(self, values: Tensor, column: Tensor) -> Tensor:
        """Returns the column (N,) of values (N, C, ...), (N, ...)."""
        return values[:, 0] if values.shape[1] == 1 else values[self._rows, column]

    def _chosen(self, rows: Tensor) -> Tensor:
        chosen = torch.zeros(len(self._rows), dtype=torch.bool, device=self._rows.device)
        chosen[rows] = True
        return chosen


_DISTANCES = ("ee_to_object", "ee_to_rest", "object_to_goal", "ee_to_handle")

_CHANGES = (
    *(f"{name}_decrease_m" for name in _DISTANCES),
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


def select_rows(chosen: Tensor, new: Measures, old: Measures) -> Measures:
    """Returns `new` in the chosen rows (N,) and `old` elsewhere."""
    values = {}
    for f in fields(Measures):
        a, b = getattr(new, f.name), getattr(old, f.name)
        mask = chosen.view(-1, *([1] * (a.dim() - 1)))
        values[f.name] = torch.where(mask, a, b)
    return Measures(**values)
