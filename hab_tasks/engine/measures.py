"""Named measures, and the only mutable state of an episode.

`Measures` are computed from two consecutive snapshots. `Tracker` keeps the history (accumulated
force, previous distances, earlier grasps) and advances exactly once per control step. Measures
refer to one object, one door or drawer and one navigation goal: those of the skill, or of the
current part of a task (`Focus`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, get_type_hints

import numpy as np
from torch import Tensor

from hab_tasks.arrays import (
    Batch,
    Bools,
    Floats,
    Ints,
    angle_between,
    norm,
    put_rows,
    row_mask,
    to_tensors,
)
from hab_tasks.constants import CONTROL_HZ, PLACE_RADIUS_M, REST_SPEED_M_S, REST_STEPS
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.privileged import Array
from hab_tasks.world.navigation import NavigationMap
from hab_tasks.world.scenes.floor import CELL_M

REST_STEP_M = REST_SPEED_M_S / CONTROL_HZ
"""Distance moved in one control step below which an object is at rest."""


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of one step, (N,) each except the last two, with unit and meaning (`MEANINGS`).

    A ``_decrease`` is d_{t-1} - d_t (S C), 0 in the first step; ``_now`` means in this step.
    """

    ee_to_object_m: Annotated[Floats, "m", "end-effector to the target's centre of mass"]
    ee_to_rest_m: Annotated[Floats, "m", "end-effector to its resting position, base frame"]
    object_to_goal_m: Annotated[Floats, "m", "target's centre of mass to its goal"]
    ee_to_handle_m: Annotated[Floats, "m", "end-effector to the handle"]
    ee_to_object_decrease_m: Annotated[Floats, "m", "decrease of ee_to_object_m"]
    ee_to_rest_decrease_m: Annotated[Floats, "m", "decrease of ee_to_rest_m"]
    object_to_goal_decrease_m: Annotated[Floats, "m", "decrease of object_to_goal_m"]
    ee_to_handle_decrease_m: Annotated[Floats, "m", "decrease of ee_to_handle_m"]
    holding_target: Annotated[Bools, "bool", "the gripper holds the target"]
    holding_other: Annotated[Bools, "bool", "the gripper holds another object"]
    holding_handle: Annotated[Bools, "bool", "the gripper holds the handle"]
    picked_now: Annotated[Bools, "bool", "the target was grasped"]
    picked_other_now: Annotated[Bools, "bool", "another object was grasped"]
    dropped_now: Annotated[Bools, "bool", "the target left the hand"]
    ee_to_rest_gain_m: Annotated[
        Floats, "m", "decrease of ee_to_rest_m from the latest grasp or release up to this step"
    ]
    object_to_goal_gain_m: Annotated[Floats, "m", "the same of object_to_goal_m"]
    released: Annotated[Bools, "bool", "the target is within 0.15 m of its goal and not held"]
    released_before: Annotated[Bools, "bool", "the target was released at an earlier step"]
    placed: Annotated[Bools, "bool", "the target is released and at rest"]
    placed_before: Annotated[Bools, "bool", "the target was placed at an earlier step"]
    grabbed_now: Annotated[Bools, "bool", "the handle was grasped for the first time"]
    grabbed_before: Annotated[Bools, "bool", "the handle was grasped at an earlier step"]
    joint: Annotated[Floats, "m or rad", "position of the door or drawer"]
    joint_share: Annotated[Floats, "1", "joint as a share of its travel"]
    joint_increase: Annotated[Floats, "m or rad", "increase of joint in this step"]
    base_to_goal_m: Annotated[Floats, "m", "geodesic distance of the base to its goal"]
    base_to_goal_decrease_m: Annotated[Floats, "m", "decrease of base_to_goal_m"]
    heading_error_rad: Annotated[Floats, "rad", "between the base's heading and its goal's"]
    heading_error_decrease_rad: Annotated[Floats, "rad", "decrease of heading_error_rad"]
    stopped: Annotated[Bools, "bool", "the action was the stop action"]
    path_m: Annotated[Floats, "m", "length of the base's path since the episode began"]
    force_n: Annotated[Floats, "N", "contact force C_t on the robot, mean over the step"]
    force_total_n: Annotated[Floats, "N", "sum of C_t since the episode began"]
    steps: Annotated[Floats, "steps", "actions since the episode began"]
    ee_to_object_start_m: Annotated[Floats, "m", "ee_to_object_m when the episode began"]
    base_to_goal_start_m: Annotated[Floats, "m", "base_to_goal_m when the episode began"]
    ee_in_base_m: Annotated[Floats, "m", "(N, 3) end-effector in the base frame"]
    base_m: Annotated[Floats, "m", "(N, 2) the base in the world"]

    def scalars(self, names: tuple[str, ...]) -> dict[str, Batch]:
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

    object: Ints
    articulation: Ints


_NOWHERE = np.zeros((2, 2), dtype=np.float32)


class GeodesicDistances:
    """Geodesic distances to one goal per row; rows without a goal have distance zero."""

    def __init__(self, count: int) -> None:
        self._fields: list[Floats] = [_NOWHERE] * count
        self._origins_m = np.zeros((count, 2), dtype=np.float32)

    def set_goal(self, row: int, map_: NavigationMap, goal_m: Array) -> None:
        """Sets the goal of a row to `goal_m` (2,), or the nearest free position."""
        field = map_.geodesic_field(np.asarray(goal_m, dtype=float))
        self._fields[row] = map_.everywhere(field).astype(np.float32)
        self._origins_m[row] = map_.floor.origin_m

    def distance_m(self, base_m: Floats) -> Floats:
        """Returns distances of bases (N, 2) to their goals, (N,) [m], bilinear between cells."""
        return np.array(
            [self._of_row(row, x, y) for row, (x, y) in enumerate(base_m.tolist())],
            dtype=np.float32,
        )

    def _of_row(self, row: int, x_m: float, y_m: float) -> float:
        """Looks up one row in plain numbers, which takes a tenth of the time of arrays."""
        field, (x0, y0) = self._fields[row], self._origins_m[row].tolist()
        x = min(max((x_m - x0) / CELL_M, 0.0), field.shape[0] - 1.0)
        y = min(max((y_m - y0) / CELL_M, 0.0), field.shape[1] - 1.0)
        i, j = min(int(x), field.shape[0] - 2), min(int(y), field.shape[1] - 2)
        u, v = x - i, y - j
        (a, b), (c, d) = field[i : i + 2, j : j + 2].tolist()
        return (a * (1 - v) + b * v) * (1 - u) + (c * (1 - v) + d * v) * u


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
        nothing, never = np.zeros(count, dtype=np.float32), np.zeros(count, dtype=bool)
        self.targets: Ints = np.zeros((count, objects), dtype=np.int64)
        self.handles: Ints = np.zeros((count, articulations), dtype=np.int64)
        self.still_steps: Floats = np.zeros((count, objects), dtype=np.float32)
        self._objects_m = goals.starts_m
        self._rows: Ints = np.arange(count)
        self.focus = Focus(object=self._rows * 0, articulation=self._rows * 0)
        self._absent: dict[str, Batch] = {
            name: never if unit == "bool" else nothing for name, (unit, _) in MEANINGS.items()
        }
        vectors: dict[str, Batch] = {
            "ee_in_base_m": np.zeros((count, 3), dtype=np.float32),
            "base_m": np.zeros((count, 2), dtype=np.float32),
        }
        self.measures = Measures(**self._absent | vectors)

    def begin(self, snapshot: Snapshot, rows: Sequence[int]) -> None:
        """Starts the episodes in `rows` (R,) at `snapshot`; the other rows keep their state."""
        chosen = row_mask(len(self._rows), rows)
        free = snapshot.held[:, None] != self.targets
        # Everything rests when an episode begins; a held object has not been let go of yet.
        still = np.where(free, np.float32(REST_STEPS), np.float32(0.0))
        self.still_steps = np.where(chosen[:, None], still, self.still_steps)
        self._objects_m = np.where(chosen[:, None, None], snapshot.objects_m, self._objects_m)
        fresh = self._still(snapshot)
        fresh = replace(
            fresh,
            force_total_n=snapshot.force_n,
            ee_to_object_start_m=fresh.ee_to_object_m,
            base_to_goal_start_m=fresh.base_to_goal_m,
        )
        self.measures = select_rows(chosen, fresh, self.measures)

    def refocus(self, snapshot: Snapshot, rows: Sequence[int], focus: Focus) -> None:
        """Sets the focus of `rows` (R,); `snapshot` is the latest one.

        Totals since the episode began are kept.
        """
        chosen = row_mask(len(self._rows), rows)
        self.focus = Focus(
            object=np.where(chosen, focus.object, self.focus.object),
            articulation=np.where(chosen, focus.articulation, self.focus.articulation),
        )
        last = self.measures
        kept = {name: getattr(last, name) for name in _SINCE_THE_START}
        self.measures = select_rows(chosen, replace(self._still(snapshot), **kept), last)

    def advance(self, snapshot: Snapshot, stopped: Bools) -> None:
        """Advances by one control step; `stopped` (N,): the action was the stop action."""
        last = self.measures
        # First, as whether the target is placed depends on this step's count.
        self._watch_objects(snapshot)
        values: dict[str, Batch] = self._absent | self._distances(snapshot, last)
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
        state = {name: getattr(self.measures, name) for name in MEANINGS}
        focus = {f"focus_{name}": value for name, value in vars(self.focus).items()}
        others = {name: getattr(self, attribute) for name, attribute in _STATE.items()}
        return to_tensors(state | focus | others)

    def set_state(self, state: Mapping[str, Any], rows: Sequence[int]) -> None:
        """Restores `rows` (R,) from a state of R rows."""
        self.measures = Measures(
            **{n: put_rows(getattr(self.measures, n), rows, state[n]) for n in MEANINGS}
        )
        focus = vars(self.focus).items()
        self.focus = Focus(**{n: put_rows(v, rows, state[f"focus_{n}"]) for n, v in focus})
        for name, attribute in _STATE.items():
            setattr(self, attribute, put_rows(getattr(self, attribute), rows, state[name]))

    def at_rest(self) -> Bools:
        """Returns which objects (N, K) have been at rest since they left the hand."""
        return self.still_steps >= REST_STEPS

    def target(self) -> Ints:
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
        vectors: dict[str, Batch] = {"ee_in_base_m": s.ee_in_base_m, "base_m": s.base[:, :2]}
        blank = Measures(**self._absent | vectors)
        values: dict[str, Batch] = self._absent | vectors | self._distances(s, blank)
        values |= self._object(s, blank, values)
        if self.handles.shape[1]:
            values |= self._articulation(s, blank)
        if self.geodesic is not None:
            values |= self._navigation(s, blank, self.geodesic)
        # Changes since the blank measures, which stand for a past that did not happen.
        values |= {name: self._absent[name] for name in _CHANGES}
        values["force_n"] = s.force_n
        return Measures(**values)

    def _distances(self, s: Snapshot, last: Measures) -> dict[str, Batch]:
        """Distances of end-effector and object, and their decreases, vectorised."""
        object_m = self._of(s.objects_m, self.focus.object)
        goal_m = self._of(self.goals.goals_m, self.focus.object)
        gaps = [object_m - s.ee_m, s.ee_in_base_m - self.goals.rest_m, object_m - goal_m]
        names = _DISTANCES[:3]
        if self.handles.shape[1]:
            gaps.append(self._of(s.handles_m, self.focus.articulation) - s.ee_m)
            names = _DISTANCES
        # One norm for all, as a call on a few numbers takes as long as one on many.
        now = norm(np.array(gaps))
        values: dict[str, Batch] = dict(zip(names, now, strict=True))
        for name in names:
            values[_DECREASE[name]] = getattr(last, name) - values[name]
        return values

    def _object(self, s: Snapshot, last: Measures, now: dict[str, Batch]) -> dict[str, Batch]:
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

    def _articulation(self, s: Snapshot, last: Measures) -> dict[str, Batch]:
        """Grasp of the handle, and joint position."""
        focus = self.focus.articulation
        joint = self._of(s.joints, focus)
        goals = self.goals
        lower, upper = self._of(goals.joint_lower, focus), self._of(goals.joint_upper, focus)
        holding = s.held_handle == self._of(self.handles, focus)
        # Paid once an episode: letting go and grasping again would earn it forever.
        before = last.grabbed_before | last.holding_handle
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
    ) -> dict[str, Batch]:
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

    def _of(self, values: Batch, column: Ints) -> Batch:
        """Returns values (N, C, ...) at the column (N,) of each row, (N, ...)."""
        # The common cases without fancy indexing, which takes several times as long.
        if values.shape[1] == 1:
            return values[:, 0]
        if len(column) == 1:
            return values[:, int(column[0])]
        return values[self._rows, column]


_DISTANCES = ("ee_to_object_m", "ee_to_rest_m", "object_to_goal_m", "ee_to_handle_m")
_DECREASE = {name: f"{name.removesuffix('_m')}_decrease_m" for name in _DISTANCES}

_STATE = {n: n for n in ("targets", "handles", "still_steps")} | {"objects_m": "_objects_m"}
"""Entry of the state, beside measures and focus -> attribute of `Tracker`."""

_CHANGES = (
    *_DECREASE.values(),
    *("base_to_goal_decrease_m", "heading_error_decrease_rad", "joint_increase"),
    *("picked_now", "picked_other_now", "dropped_now", "grabbed_now"),
)
"""Measures of changes within a step; zero in the first step."""

_SINCE_THE_START = (
    *("force_total_n", "steps", "path_m", "stopped"),
    *("ee_to_object_start_m", "base_to_goal_start_m"),
)
"""Measures of the whole episode, independent of the focus."""


def select_rows(chosen: Bools, new: Measures, old: Measures) -> Measures:
    """Returns `new` in the chosen rows (N,) and `old` in the others."""
    values = {}
    for f in fields(Measures):
        a, b = getattr(new, f.name), getattr(old, f.name)
        mask = chosen.reshape(-1, *([1] * (a.ndim - 1)))
        values[f.name] = np.where(mask, a, b)
    return Measures(**values)
