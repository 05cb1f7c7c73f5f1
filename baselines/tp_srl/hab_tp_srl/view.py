"""The observation of a skill, computed from that of a task (S H.2).

A skill's environment observes one point: where its object was when the skill began, or the
object's goal. In a task this point is known from ``targets_in_base``, which has the places of all
objects at the start of the episode, in the frame of the moving base. An object that starts in a
drawer is carried with it, as ``handles_in_base`` shows or, without this entry, the hand that pulls.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from hab_navigator.robot_map import turned
from hab_plans.belief import Opening
from hab_plans.stage import Stage
from hab_spa.sensing.fitted_box import HELD_UP
from hab_spa.shapes import Array
from numpy.typing import NDArray

from hab_tasks.constants import REST_RADIUS_M
from hab_tasks.privileged import PrivilegedState
from hab_tasks.robots.spec import RobotSpec
from hab_tp_srl.felt import FeltBeliefs
from hab_tp_srl.in_hand import InHand
from hab_tp_srl.sight import (
    AJAR_RAD,
    Fronts,
    Look,
    find_door,
    is_other,
    is_there,
    outward,
    seen_through,
)
from hab_tp_srl.watch import Watch

MOST_DOUBTS = 4
"""After so many picks that look wrong, what is seen there is taken for something else."""

Entries = dict[tuple[str, str], NDArray[Any]]
"""(group, name) -> entry of a state observation, float32."""


class TaskView:
    """What the robot of one row observes in a task.

    Attributes:
        truth, feels, sees: As given.
        felt: What it believes without ground truth.
    """

    def __init__(
        self,
        *,
        truth: bool,
        aims_object: bool = False,
        openings: Sequence[Opening] = (),
        inside: Sequence[int | None] = (),
        feels: bool = False,
        sees: bool = False,
    ) -> None:
        """Creates a view.

        Args:
            truth: Whether objects, handles and the base are known from the ground truth, instead
                of the task's observation.
            aims_object: Whether Place observes its goal from the held object, as it was when it was
                grasped, instead of from the hand.
            openings: Which doors and drawers are open at the start of an episode.
            inside: For each object, the number of the one into which it is to be put.
            feels: Whether it notices where an object was let go, and looks for it there.
            sees: Whether, then, it also looks with the head camera.
        """
        self.truth, self.feels, self.sees = truth, feels, feels and sees
        self._aims_object, self._openings, self._inside = aims_object, openings, inside
        self._obs: Mapping[str, Any] = {}
        self._row = 0
        self._located: tuple[float, float, float] | None = None
        self.forget()

    def forget(self) -> None:
        """Starts a new episode."""
        self._starts_m: Array | None = None
        self.felt = FeltBeliefs(np.zeros((0, 3)), np.zeros((0, 3)), self._openings)
        self._fronts, self._fridge = Fronts(), None
        self._pulled_m: dict[int, Array] = {}
        self._moving: int | None = None
        self._left, self._pulls = True, False
        self._hand_m: Array | None = None
        self._in_hand, self._watch = InHand(), Watch()

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Takes the observation of a row, at every step; it is read when it is needed."""
        self._obs, self._row, self._located = obs, row, None
        if self._starts_m is None:
            self._first_m = self._pairs_m
            places_m = self._to_frame(self._first_m)
            self._starts_m, self._goals_m = places_m[:, 0], places_m[:, 1]
            self._handles_m = self._handles()
            self.felt = FeltBeliefs(self._starts_m, self._goals_m, self._openings)
        self._pull()
        if self.holding and self._in_hand.reaches:
            self._in_hand.close(self._hand_now_m, self._frame_from_ee)
        if self.feels and self.holding != self.felt.holding:
            self.felt.feel(self.holding, self._hand_now_m)

    def begin(self, stage: Stage) -> None:
        """Notes that a skill begins: where an object was shows where it is in the hand."""
        self._moving, self._hand_m, self._left = stage.articulation, None, not self.holding
        self._pulls = False
        reached_m = self.point(stage) if stage.skill == "pick" else None
        self._in_hand.reach(reached_m, stage.drawer is not None)
        self.felt.begin(stage)

    def end(self, stage: Stage, ended: bool) -> None:
        """Notes that a skill has ended, by its own condition or not."""
        pulled_m = None
        if self._pulls:
            assert stage.articulation is not None
            pulled_m = float(np.linalg.norm(self._pulled_m[stage.articulation]))
        self.felt.end(stage, ended, pulled_m)

    def look(self, robot: RobotSpec) -> Look:
        """Looks with the head camera."""
        return Look.take(robot, self._obs, self._row, self.arm_qpos)

    def see_held(self, look: Look) -> None:
        """Notes where an object from a drawer is in the hand: it may have slid in there."""
        in_ee_m = self._seen_in_ee_m(look) if self._in_hand.slides else None
        if in_ee_m is not None:
            self._in_hand.in_ee_m = in_ee_m
            self.felt.hold(self._frame_from_ee @ in_ee_m)

    def see_placed(self, robot: RobotSpec, number: int, before: Look) -> Array | None:
        """Notes where an object has come to lie since a look; that may be beside its goal.

        Returns:
            (3,) the place in the base frame; None if nothing that was placed is seen.
        """
        found_m = self.look(robot).appeared_m(before, self._in_base(self._goals_m[number]))
        if found_m is None or self.felt.held == number:
            return None
        self.felt.places_m[number] = self._to_frame(outward(found_m))
        return found_m

    def see_moved(self, look: Look, number: int, point_m: Array) -> bool:
        """Whether an object is not seen at (3,), but something beside it or on the floor."""
        places_m = self._in_base(self.felt.places_m)
        others_m = [one_m for k, one_m in enumerate(places_m) if k != number]
        ee_m, here_m = self._felt("ee_position").astype(float), self._in_base(point_m)
        found_m = self._watch.moved_m(look, number, here_m, ee_m, others_m)
        if found_m is not None:
            self.felt.places_m[number] = self._to_frame(outward(found_m))
            self.felt.moved[number] = True
        return found_m is not None

    def see_all(self, look: Look) -> None:
        """Notes where objects are seen; of those that doors or drawers hide, once they are out."""
        for number, place_m in enumerate(self.felt.places_m):
            if number != self.felt.held and (self.felt.moved[number] or not self._openings):
                self.see_moved(look, number, place_m)

    def took_other(self, robot: RobotSpec, before: Look, point_m: Array) -> bool:
        """Whether the hand has taken something else since a look than what was at a point (3,).

        The target is in the hand where it was when the hand closed, and it stands at the point no
        longer; another object was seen elsewhere. Nothing is known of what was hidden.
        """
        held = self.felt.held
        if held is None or self.felt.doubts[held] >= MOST_DOUBTS:
            return False
        after, aside_m = self.look(robot), None
        in_ee_m = self._seen_in_ee_m(after, before)
        if in_ee_m is not None:
            aside_m = float(np.linalg.norm(in_ee_m - self._in_hand.in_ee_m))
        other = is_other(before, after, self._in_base(point_m), aside_m)
        if other and in_ee_m is not None:
            self._in_hand.in_ee_m = in_ee_m
        return other

    def take_for_other(self) -> Array:
        """Notes that what is held is not what was to be picked; returns where it was (3,)."""
        self.felt.take_for_other()
        return self._in_hand.place_m()

    def see_front(self, look: Look, number: int) -> None:
        """Notes what is seen before a door or drawer is first opened."""
        if self._openings[number] == "closed":
            self._fronts.see(number, self._to_frame(look.surfaces_m))

    def see_opened(self, look: Look, number: int) -> None:
        """Notes what has moved when a door or drawer was opened."""
        if self.felt.openings[number] == "open":
            self._fronts.keep(number, lambda points_m: seen_through(look, self._in_base(points_m)))

    def see_closed(self, look: Look, stage: Stage, number: int) -> bool:
        """Returns whether a stage's door or drawer is seen to be closed, and believes it.

        One that is not in view is taken for open: it may be, and the way to close it leads there.
        """
        front_m, inside_m = self._fronts.of(number), self._in_base(self.point(stage))
        closed, hinged = True, stage.skill == "close_fridge"
        if hinged:
            self._fridge = find_door(look, inside_m, self._fridge)
            closed = self._fridge is None or self._fridge.pose[3] <= AJAR_RAD
        if closed and len(front_m):
            closed = is_there(look, self._in_base(front_m), hinged=hinged)
        elif closed and (self._fridge is None or not hinged):  # what was felt counts
            felt = self._pulls or not hinged
            closed = felt and self.felt.openings[number] == "closed"
        self.felt.openings[number] = "closed" if closed else "ajar"
        return bool(closed)

    def goal_m(self, number: int) -> Array:
        """Returns the goal (3,) of an object, in the frame of `point`."""
        return self._goals_m[number]

    @property
    def holding(self) -> bool:
        """Whether anything is in the hand."""
        return bool(self._felt("is_holding")[0] > 0)

    @property
    def rests(self) -> bool:
        """Whether the end-effector is at its resting position."""
        return float(np.linalg.norm(self._felt("rest_from_ee"))) < REST_RADIUS_M

    @property
    def base(self) -> Array:
        """Base pose x, y [m] and yaw [rad] (3,) in the frame of `point`."""
        return np.array(self._base)

    @property
    def arm_qpos(self) -> Array:
        """Joint positions of the arm (J,) [rad]."""
        return self._felt("arm_qpos").astype(float)

    def point(self, stage: Stage) -> Array:
        """Returns the point (3,) that a skill observes if it begins now.

        It is in a frame that does not move: the world with ground truth, else the frame of the
        base at the start of the episode.
        """
        assert self._starts_m is not None
        if stage.at == "goal":
            return self._goals_m[stage.object] + self._beside_m(stage)
        if self._state is not None and stage.skill == "pick":
            return self._state.object_com_m[self._state.targets[stage.object]]
        if stage.skill == "pick" and self.felt.moved[stage.object]:
            return self.felt.places_m[stage.object]
        point_m = self._starts_m[stage.object]
        return point_m if stage.drawer is None else point_m + self._moved_m(stage.drawer)

    def _beside_m(self, stage: Stage) -> Array:
        """Returns how far (3,) what an object is put into is believed to be beside its goal."""
        into = self._inside[stage.object] if self.feels and stage.skill == "place" else None
        if into is None or not self.felt.moved[into]:
            return np.zeros(3)
        return self.felt.places_m[into] - self._goals_m[into]

    def moved_m(self, articulation: int) -> float | None:
        """Returns how far a handle is from its place at the start; None if it is not observed."""
        now, first = self._handles(), self._handles_m
        if now is None or first is None:
            return None
        return float(np.linalg.norm(now[articulation] - first[articulation]))

    def entries(self, stage: Stage, point_m: Array, aims: bool = True) -> Entries:
        """Returns the entries that the skill's environment could observe.

        Args:
            stage: The stage.
            point_m: (3,) its `point` when it began.
            aims: Whether Place may observe its goal from the held object.
        """
        ee_m, axes, point = self._felt("ee_position"), self._ee_axes, self._in_base(point_m)
        if self._aims_object and aims and stage.skill == "place":
            point = point - axes.T @ self._in_hand.in_ee_m
        agent = self._obs["agent"]
        found: Entries = {
            ("agent", name): np.asarray(values[self._row]) for name, values in agent.items()
        }
        found["extra", "point_in_base"] = point
        found["extra", "point_in_ee"] = axes @ (point - ee_m)
        found["extra", HELD_UP] = self._in_hand.up_in_ee
        for name in ("object_start", "object_goal"):
            found["extra", f"{name}_from_ee"] = point - ee_m
            found["extra", f"{name}_in_ee"] = axes @ (point - ee_m)
        handles_m = self._handles()
        if stage.articulation is not None and handles_m is not None:
            found["extra", "handle_from_ee"] = self._in_base(handles_m[stage.articulation]) - ee_m
        return {path: value.astype(np.float32) for path, value in found.items()}

    @property
    def _state(self) -> PrivilegedState | None:
        """The true state; None without ground truth."""
        return self._obs["privileged"][self._row] if self.truth else None

    @property
    def _pairs_m(self) -> Array:
        """Starts and goals of the objects (K, 2, 3) in the base frame."""
        return self._told("targets_in_base").reshape(-1, 2, 3).astype(float)

    @property
    def _base(self) -> tuple[float, float, float]:
        """x, y [m] and yaw [rad] of the base in the resting frame."""
        if self._located is None:
            self._located = self._locate(self._pairs_m)
        return self._located

    def _felt(self, name: str) -> Array:
        """Returns an entry of the robot's own state."""
        return np.asarray(self._obs["agent"][name][self._row])

    def _told(self, name: str) -> Array:
        """Returns an entry of what the task tells."""
        return np.asarray(self._obs["extra"][name][self._row])

    @property
    def _hand_now_m(self) -> Array:
        """The end-effector (3,) in the resting frame."""
        return self._to_frame(self._felt("ee_position").astype(float))

    @property
    def _frame_from_ee(self) -> Array:
        """Rotation (3, 3) of the end-effector in the resting frame."""
        axes = self._ee_axes
        return np.concatenate((turned(axes[:, :2], self._base[2]), axes[:, 2:]), axis=1).T

    @property
    def _ee_axes(self) -> Array:
        """Axes of the end-effector in the base frame, as rows (3, 3)."""
        rotation = self._felt("ee_rotation").reshape(2, 3)
        return np.concatenate((rotation, np.cross(rotation[0], rotation[1])[None]))

    def _seen_in_ee_m(self, look: Look, before: Look | None = None) -> Array | None:
        """Returns where (3,) an object is seen in the hand; None if none is."""
        ee_m = self._felt("ee_position").astype(float)
        found_m = look.held_m(ee_m, before)
        return None if found_m is None else self._ee_axes @ (outward(found_m) - ee_m)

    def _moved_m(self, drawer: int) -> Array:
        """Returns how far a drawer has moved since the start of the episode, (3,)."""
        now, first = self._handles(), self._handles_m
        if now is None or first is None:
            return self._pulled_m.get(drawer, np.zeros(3))
        return now[drawer] - first[drawer]

    def _pull(self) -> None:
        """Adds the motion of a hand that holds a handle."""
        # The hand may still hold another handle, that of the skill before.
        self._left |= not self.holding
        if self._moving is None or not self.holding or not self._left:
            self._hand_m = None
            return
        hand_m = self._hand_now_m
        if self._hand_m is not None:
            self._fronts.touch(self._moving, self._hand_m)
            self._pulls = True
            so_far_m = self._pulled_m.get(self._moving, np.zeros(3))
            self._pulled_m[self._moving] = so_far_m + hand_m - self._hand_m
        self._hand_m = hand_m

    def _handles(self) -> Array | None:
        """Returns the handles (J, 3) in the resting frame; None if they are not observed."""
        if self._state is not None:
            return np.array([found.handle_m for found in self._state.articulations]).reshape(-1, 3)
        if "handles_in_base" not in self._obs["extra"]:
            return None
        return self._to_frame(self._told("handles_in_base").reshape(-1, 3).astype(float))

    def _locate(self, pairs_m: Array) -> tuple[float, float, float]:
        """Returns x, y [m] and yaw [rad] of the base in the resting frame.

        Without ground truth, the places of the objects, which do not move, are landmarks.
        """
        if self._state is not None:
            pose = self._state.world_from_base
            return float(pose[0, 3]), float(pose[1, 3]), math.atan2(pose[1, 0], pose[0, 0])
        then, now = self._first_m.reshape(-1, 3)[:, :2], pairs_m.reshape(-1, 3)[:, :2]
        from_mean, to_mean = now - now.mean(axis=0), then - then.mean(axis=0)
        sine = float((from_mean[:, 0] * to_mean[:, 1] - from_mean[:, 1] * to_mean[:, 0]).sum())
        yaw = math.atan2(sine, float((from_mean * to_mean).sum()))
        x, y = then.mean(axis=0) - turned(now.mean(axis=0), yaw)
        return float(x), float(y), yaw

    def _to_frame(self, points_m: Array) -> Array:
        """Maps points (..., 3) from the base frame to the resting frame; heights are kept."""
        x, y, yaw = self._base
        level = turned(points_m[..., :2], yaw) + np.array((x, y))
        return np.concatenate((level, points_m[..., 2:]), axis=-1)

    def _in_base(self, points_m: Array) -> Array:
        """Maps points (..., 3) from the resting frame to the base frame; heights are kept."""
        x, y, yaw = self._base
        level_m = turned(points_m[..., :2] - np.array((x, y)), -yaw)
        return np.concatenate((level_m, points_m[..., 2:]), axis=-1)
