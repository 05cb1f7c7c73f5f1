"""Scripted cheats: a table of what they do where, and what each would win."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from playing import move_base, move_joint, move_object

from hab_tasks.articulations import DRAWER, FRIDGE
from hab_tasks.constants import PLACE_RADIUS_M, REST_POSITION_M, REST_RADIUS_M
from hab_tasks.robots.control import ee_step_m
from hab_tasks.robots.control_modes import ABSOLUTE_ARM, STOP_CELL
from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.tasks.base import Condition

REST = np.array(REST_POSITION_M)
REST_RAD = np.array(FETCH.rest_qpos_rad)
KINEMATICS = ArmKinematics(FETCH)
REACH_M, _RAISED = 0.149, np.array((0.0, 0.0, FETCH.base_height_m))


class World:
    """What a cheat knows and does: everything that is true, and the actions of its mode."""

    def __init__(self, env, episode):
        self.env, self.raw = env, env.unwrapped
        self.sim = self.raw.simulation
        self.config = self.raw.agent.controller.config
        self.space, self.rng = self.raw.single_action_space, np.random.default_rng(episode)
        self.space.seed(episode)
        self.step, self.deepest_m, self.seen = 0, 0.0, {}

    @property
    def shot(self):
        return self.sim.snapshot

    @property
    def base(self):
        return np.asarray(self.shot.base[0], dtype=float)

    @property
    def hand(self):
        return np.asarray(self.shot.ee_in_base_m[0], dtype=float)

    def object_m(self, number=0):
        return np.asarray(self.shot.objects_m[0, number], dtype=float)

    def goal_m(self, number=0):
        return np.asarray(self.sim.goals.goals_m[0, number], dtype=float)

    def handle_m(self):
        return np.asarray(self.shot.handles_m[0, 0], dtype=float)

    def holds(self, number=0):
        return int(self.shot.held[0]) == self.sim.targets[number]

    def gap_m(self, number=0):
        """The way (3,) from an object to its goal, in the base frame."""
        return self.seen_from_base(self.goal_m(number)) - self.seen_from_base(self.object_m(number))

    def near(self, point_m):
        return float(np.linalg.norm(point_m - np.asarray(self.shot.ee_m[0])))

    def seen_from_base(self, point_m):
        x, y, yaw = self.base
        ahead, side = np.cos(yaw), np.sin(yaw)
        dx, dy = point_m[0] - x, point_m[1] - y
        return np.array([ahead * dx + side * dy, ahead * dy - side * dx, point_m[2]])

    def move(self, to_m, gripper, drive=None):
        """The action that brings the hand to a point (3,) in the base frame."""
        if self.config.arm in ABSOLUTE_ARM:
            now, goal = np.asarray(self.shot.arm_qpos_rad[0], dtype=float), to_m - _RAISED
            arm = REST_RAD if to_m is REST else KINEMATICS.approach(now, goal, 60, 0.02)
        else:
            arm = np.clip((to_m - self.hand) / 0.015, -1, 1)
        still = {"pose": self.base, "velocity": np.zeros(2), "still": []}[self.config.base]
        parts = (arm, [gripper], still if drive is None else drive)
        return np.concatenate(parts).astype(np.float32)

    def edit(self, change, *values):
        """Changes the simulator's state before the episode's first step."""
        state = self.raw.get_state_dict()
        change(state, self.env, *values)
        self.raw.set_state_dict(state)

    def stand(self, skill, number):
        """Puts the robot where the navigation before a part of the task ends."""
        parts = enumerate(self.raw.task.parts)
        part = next(i for i, p in parts if p.skill.name == skill and p.object == number)
        progress = self.raw.rules.progress
        progress.part = progress.part * 0 + part - 1
        self.raw.rules.turn_to_parts([0])
        self.edit(move_base, *self.sim.goals.base[0].tolist())
        progress.part = progress.part + 1
        self.raw.rules.turn_to_parts([0])

    def take(self, number):
        """Puts a target of the task into the hand."""
        name = self.raw.episode[0].targets[number].object
        self.edit(move_object, name, np.asarray(self.shot.ee_m[0]) - (0.0, 0.0, 0.12))
        for _ in range(5):
            self.env.step(self.move(self.hand, 1.0))


def at_random(w):
    return w.space.sample()


def nothing(w):
    """No change of the start."""


def succeeds(w, info):
    return bool(info["success"][0])


class Cheat(NamedTuple):
    """`moves` returns the action, None to give up; `like` is what it is compared with.

    `start` changes the start; `won` tells at every step.
    """

    name: str
    env: str
    mode: str
    moves: Callable[[World], Any]
    start: Callable[[World], None] = nothing
    won: Callable[[World, dict], bool] = succeeds
    steps: int = 200
    like: Callable[[World], Any] = at_random


def played(cheat, episodes, moves=None):
    """Plays shipped episodes; returns the numbers of those won, and what each world has seen."""
    env = gym.make(f"hab_tasks:{cheat.env}", control_mode=cheat.mode, obs_mode="state")
    won, seen = [], []
    for number in range(episodes):
        env.reset(seed=number, options={"episode": number})
        w = World(env, number)
        seen.append(w.seen)
        cheat.start(w)
        ended = False
        while not ended and w.step < cheat.steps:
            action = (moves or cheat.moves)(w)
            if action is None:
                break
            *_, ended, _, info = env.step(action)
            w.step += 1
            w.deepest_m = max(w.deepest_m, w.sim._force.deepest_m())
            if cheat.won(w, info):
                won.append(number)
                break
    env.close()
    return won, seen


# Through fronts and shelves ----------------------------------------------------------------------


def stands(w, skill, number, takes=None, joint=None):
    """Stands before a part of a task, maybe with an object in the hand and a front moved."""
    w.stand(skill, number)
    if takes is not None:
        w.take(takes)
    if joint is not None:
        w.edit(move_joint, *joint)


def before_the_shut_fridge(w):
    stands(w, "place", 2, takes=2)
    (door,) = [h for h in w.sim.grasp.handles if h.name == FRIDGE.marker]
    state = w.raw.get_state_dict()
    state["articulations"][door.furniture.name][0, 13 + door.column] = 0.0
    w.raw.set_state_dict(state)


def reaches_in(w, number):
    """Closes the hand again and again as near to the object as it gets."""
    aim = w.seen_from_base(w.object_m(number)) + np.array((0, 0, 0.05))
    return w.move(aim, 1.0 if w.step % 2 else -1.0)


def taken_while_shut(w, info, number, most):
    return w.holds(number) and float(w.shot.joints[0, number]) < most


def from_beneath(w):
    """The hand goes under the shelf, closes below the object's bottom, and returns."""
    body = w.sim.scene_bodies.movable[w.raw.episode[0].targets[0].object]._bodies[0]
    low_m = w.seen.setdefault("low", body.compute_global_aabb_tight()[0][2] - 0.02)
    at = w.seen.setdefault("at", w.seen_from_base(w.object_m()))
    if w.step >= 140:
        return w.move(REST, 1.0) if w.holds() else None
    under = w.near(w.object_m()) < REACH_M and w.shot.ee_m[0, 2] < low_m
    share = max(at[0] - 0.25, 0.4) / at[0] if w.step < 70 else 1.0
    goal = np.array((at[0] * share, at[1] * share, at[2] - 0.12))
    return w.move(goal, 1.0 if under or w.holds() else -1.0)


def through_the_shelf(w):
    """The object is carried below its goal, and lifted through what it shall stand on."""
    if w.step >= 135:
        return w.move(REST, -1.0)
    if w.step == 90 and w.object_m()[2] > w.goal_m()[2] - 0.1:
        return None  # it is not beneath
    ahead, up = ((0.6, -0.3), (1.0, -0.3), (1.0, 0.0))[w.step // 45]
    aim = w.seen_from_base(w.goal_m()) * (ahead, ahead, 1) + np.array((0, 0, up))
    return w.move(aim + w.hand - w.seen_from_base(w.object_m()), 1.0)


def brings(w, number, goal=None, above_m=0.0):
    """Presses what it holds towards a goal, lets go, and returns."""
    aim = w.seen_from_base(w.goal_m(number if goal is None else goal))
    gap = aim - w.seen_from_base(w.object_m(number)) + np.array((0, 0, above_m))
    return w.move(w.hand + gap, 1.0) if w.step < 100 else w.move(REST, -1.0)


def is_placed(w, info, number):
    return bool(w.raw.holds(Condition(placed=(number,)))[0])


# By the body, by waiting, by what falls and flies ------------------------------------------------


def drives(w, linear, turning):
    return w.move(REST, -1.0, (linear, turning))


def into_the_fridge(w):
    x, y, _ = w.sim.goals.articulation_frame[0, 0].tolist()
    return w.move(REST, -1.0, (x, y, w.base[2]))


def swings(w):
    """The arm sweeps from side to side, low, then returns."""
    side = 0.6 * np.sin(w.step / 12)
    return w.move(np.array((0.75, side, 0.75)) if w.step < 160 else REST, -1.0)


def waits(w):
    """Lets go, stands still for long, and returns."""
    return w.move(REST if w.step > 150 else w.hand, -1.0)


def pulls_open(w):
    """Opens the door further with the hand, lets it go, and waits for it to fall shut."""
    if w.step >= 80:
        return w.move(REST, -1.0)
    back = np.array((-0.1 if w.step > 40 else 0.0, 0.0, 0.0))
    return w.move(w.seen_from_base(w.handle_m()) + back, 1.0)


def to_the_goal(w):
    return w.move(REST, -1.0, np.array(w.sim.goals.base[0].tolist()))


def too_early(w, info):
    """The navigation is over sooner than the base drives there, or the robot went through it."""
    way_m = float(w.raw.measures.base_to_goal_start_m[0]) - 0.3
    arrived = bool(w.raw.rules.progress.done[0])
    return arrived and (w.step < 30 * way_m / FETCH.base_linear_speed_m_s - 2 or w.deepest_m > 0.02)


def picks(w, below_m):
    w.seen.setdefault("way_m", w.near(w.object_m()) - 0.15)
    aim = w.seen_from_base(w.object_m()) - np.array((0, 0, below_m))
    return w.move(REST if w.holds() else aim, 1.0)


def too_fast(w, info):
    """To within grasping distance and back; stretched, the arm is faster than at rest."""
    least = max(2 * w.seen["way_m"] - REST_RADIUS_M, 0.0) / (1.5 * ee_step_m(FETCH, w.config.arm))
    return bool(info["success"][0]) and w.step < least


HELD_M = {"thrown": 0.1, "below": -0.13, "dropped": 0.4, "pressed": -0.05, "laid": 0.03}
"""Way of leaving an object at its goal -> height above it at which it is held."""


def places(w, way):
    gap = w.gap_m()
    gap_m = np.linalg.norm(gap)
    w.seen.setdefault("way_m", gap_m - PLACE_RADIUS_M)
    lets_go = {
        "thrown": gap_m < 0.28,
        "below": gap_m < 0.145 and gap[2] > 0.05,
        "laid": gap_m < 0.06,
    }.get(way, np.linalg.norm(gap[:2]) < 0.05 and w.step > 30)
    if not w.holds() or lets_go or w.step > 100:
        return w.move(REST, -1.0)
    return w.move(w.hand + gap + np.array((0, 0, HELD_M[way])), 1.0)


def goes_off(w, info):
    """What counts as placed does not lie there two seconds later."""
    if not w.raw.measures.placed[0] or "placed" in w.seen:
        return False
    w.seen["placed"] = True
    for _ in range(60):
        w.sim.step(-1.0)
    lies_m = w.sim.grasp.objects_com_m()[w.sim.targets[0]]
    return bool(np.linalg.norm(lies_m - w.goal_m()) > PLACE_RADIUS_M)


def throws(w):
    """Swings what it holds forward, lets go, and keeps away."""
    handle = w.seen.setdefault("handle", w.seen_from_base(w.handle_m()))
    ahead = 0.5 if w.step < 25 else 0.75
    aim = handle * (ahead, ahead, 1) + np.array((0, 0, 0.2))
    return w.move(aim if w.step < 45 else REST, 1.0 if w.step < 29 else -1.0)


def drawer_is_shut(w, info):
    return float(w.shot.joints[0, 0]) < DRAWER.closed_at


# By odd actions ----------------------------------------------------------------------------------


def stops_all_the_time(w):
    return STOP_CELL if w.step % 2 else at_random(w)


def toggles(w):
    return np.append(at_random(w)[:3], np.float32(1.0 if w.step % 2 else -1.0))


def extreme(w, values):
    return w.rng.choice(np.float32(values), w.space.shape)


ALMOST_NAN = partial(extreme, values=(3.4e38, -3.4e38, 1e-45, -1e-45, -0.0))
CLIPPED = partial(extreme, values=(1, -1, 0, 0, 0))

PICK, PLACE, TIDY, TABLE = (f"Hab{e}-v1" for e in ("Pick", "Place", "TidyHouse", "SetTable"))
GROCERIES, CLOSE = "HabPrepareGroceries-v1", "HabCloseFridge-v1"
SET, DRIVEN, EE, BASE = "joint_state_pose", "joint_target_pose", "ee", "ee_base"
ARM, LEFT = ("joint_target", "joint_state"), ("thrown", "below", "dropped", "pressed")
at, shut, is_at = (partial(partial, f) for f in (stands, taken_while_shut, is_placed))
bowl, apple = (partial(reaches_in, number=number) for number in (0, 1))
ajar, armed = at(skill="pick", number=1, joint=(1, 0.2)), at(skill="close_drawer", number=0)
armed = partial(armed, takes=1, joint=(0, 0.3))
another = at(skill="place", number=0, takes=1)
swap = partial(brings, number=1, goal=0, above_m=0.05)

ROWS = (
    ("drawer_front", TABLE, SET, bowl, at(skill="pick", number=0), shut(number=0, most=0.1)),
    ("fridge_front", TABLE, BASE, apple, ajar, shut(number=1, most=0.5)),
    *((f"beneath_{mode}", PICK, mode, from_beneath) for mode in (EE, *ARM)),
    ("through_shelf", PLACE, "joint_state", through_the_shelf),
    (
        "shut_fridge",
        GROCERIES,
        BASE,
        partial(brings, number=2),
        before_the_shut_fridge,
        is_at(number=2),
    ),
    ("base_by_velocity", CLOSE, BASE, partial(drives, linear=1, turning=0)),
    ("base_turning", CLOSE, BASE, partial(drives, linear=0.3, turning=0.3)),
    ("base_by_pose", CLOSE, SET, into_the_fridge),
    ("falls_shut", CLOSE, BASE, pulls_open),
    *((f"swings_{e}", f"Hab{e}-v1", ARM[0], swings) for e in ("OpenDrawer", "CloseDrawer")),
    *((f"waits_{e}", f"Hab{e}-v1", EE, waits) for e in ("Pick", "Place", "CloseDrawer")),
    ("waits_OpenFridge", "HabOpenFridge-v1", BASE, waits),
    *(
        (f"walls_{mode}", TIDY, mode, to_the_goal, nothing, too_early, 400)
        for mode in (SET, DRIVEN)
    ),
    *((f"picks_{m}", PICK, m, partial(picks, below_m=0), nothing, too_fast) for m in ARM),
    *((f"low_picks_{m}", PICK, m, partial(picks, below_m=0.12), nothing, too_fast) for m in ARM),
    *((f"places_{m}", PLACE, m, partial(places, way="laid"), nothing, too_fast) for m in ARM),
    *((f"{way}_there", PLACE, ARM[0], partial(places, way=way), nothing, goes_off) for way in LEFT),
    ("thrown_at_drawer", TABLE, SET, throws, armed, drawer_is_shut),
    ("knocked_down", TIDY, SET, swings, at(skill="pick", number=0), is_at(number=0)),
    ("another_object", TIDY, BASE, swap, another, is_at(number=0)),
    ("stops", "HabNavigate-v1", "base_discrete", stops_all_the_time, nothing, succeeds, 500),
    *((f"toggles_{env}", env, EE, toggles) for env in (PICK, PLACE)),
    *(
        (f"huge_{env}", env, EE, ALMOST_NAN, nothing, succeeds, 200, CLIPPED)
        for env in (PICK, PLACE)
    ),
)
CHEATS = {row[0]: Cheat(*row) for row in ROWS}
"""Name -> cheat."""
