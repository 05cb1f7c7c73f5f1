"""Scripted robots for the long tasks: skill after skill, from places where each can be done."""

from collections.abc import Callable

import numpy as np
from oracle_robot import SAMPLES, Robot
from oracles import (
    close_drawer,
    drawer_grasps,
    drive_to,
    drops,
    grasp_points,
    open_drawer,
    pick,
    place,
)
from oracles_fridge import FridgeRobot, close_fridge, open_fridge

from hab_tasks.constants import EE_STEP_M, REST_RADIUS_M
from hab_tasks.fronts import DRAWER, FRIDGE, FrontKind
from hab_tasks.measures import PLACE_RADIUS_M
from hab_tasks.navigation import NavigationMap, poses_reaching
from hab_tasks.robots.fetch_spec import EE_LOWER_M, EE_UPPER_M
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.skills.close_drawer import CLOSE_DRAWER
from hab_tasks.skills.close_fridge import CLOSE_FRIDGE
from hab_tasks.skills.open_drawer import OPEN_DRAWER
from hab_tasks.skills.open_fridge import OPEN_FRIDGE
from hab_tasks.skills.place import PLACE

PLACES, TRIALS = 24, 4
"""How many base poses are thought of, and from how many a skill is tried."""

NEAR_M = 0.05
BACK_STEPS = 15
DOOR_STEPS = 400
"""Longest time for the fridge's door, from one place."""


def do_task(robot: Robot) -> bool:
    """Does all parts of a task in their order; whether each worked out."""
    moves = {OPEN_DRAWER.name: slide, CLOSE_DRAWER.name: slide}
    moves |= {OPEN_FRIDGE.name: swing, CLOSE_FRIDGE.name: swing}
    for part in robot.core.task.parts:
        robot.object, robot.front = part.object, part.front
        name = part.skill.name
        if name == PLACE.name and not bring(robot):
            return False
        if name in moves and not moves[name](robot, out=name.startswith("open")):
            return False
    return True


def floor_map(robot: Robot) -> NavigationMap:
    """Maps the floor with everything as it stands now, except for the robot and what it holds."""
    state = robot.state()
    bodies = [body for body in state.bodies if body.group != "robot" and body.name != state.held]
    bodies = [body for body in bodies if body.name in state.world_from_body]
    return NavigationMap.of_bodies(bodies, state.world_from_body)


def at_work(
    robot: Robot, places: Callable, ways: Callable[[int], int], skill: Callable, done: Callable
) -> bool:
    """Drives to where a skill can be done, and does it; elsewhere when it does not work out.

    Args:
        robot: Who does it.
        places: (map) -> base poses (K, 3).
        ways: How many ways there are to do it from where the robot is thought to be, as far as
            so many samples tell.
        skill: Does it.
        done: Whether it is done.
    """
    for trial in range(TRIALS):
        map_ = floor_map(robot)
        for pose in _best(robot, places(map_), ways, SAMPLES * (1 + 4 * trial))[:TRIALS]:
            if done() or robot.over:
                return done()
            if drive_to(robot, map_, pose, within_m=NEAR_M):
                skill(robot)
    return done()


def _best(robot: Robot, poses: np.ndarray, ways: Callable, samples: int) -> list[np.ndarray]:
    """Returns the base poses with most ways to do something, where the arm at rest is free."""
    found = []
    for pose in poses[:: max(1, len(poses) // PLACES)]:
        robot.imagined = pose
        collision = robot.collision()
        if collision.is_free(robot.qpos):
            found.append((ways(samples), len(found), pose))
    robot.imagined = None
    found.sort(key=lambda entry: (-entry[0], entry[1]))
    return [pose for count, _, pose in found if count]


def bring(robot: Robot) -> bool:
    """Brings the object to its goal; takes it again when it is lost on the way."""

    def holds() -> bool:
        return robot.state().held == robot.target

    def let_go() -> bool:
        return not holds()

    def placed() -> bool:
        gap_m = np.linalg.norm(robot.state().object_com_m[robot.target] - robot.goal_m)
        return bool(gap_m < PLACE_RADIUS_M) and not holds()

    def grasps(samples: int) -> int:
        return len(robot.reaching(robot.collision(), grasp_points(robot), samples))

    def lowerings(samples: int) -> int:
        return len(drops(robot, robot.collision(), 0.04, samples))

    for _ in range(TRIALS):
        if placed() or robot.over:
            break
        com_m = robot.state().object_com_m[robot.target]
        at_work(robot, lambda map_, at=com_m: poses_reaching(map_, at), grasps, pick, holds)
        if holds():
            places = lambda map_: poses_reaching(map_, robot.goal_m)  # noqa: E731
            at_work(robot, places, lowerings, place, let_go)
    return placed()


def slide(robot: Robot, *, out: bool) -> bool:
    """Opens or closes the drawer."""
    upper_m = float(robot.world.goals.joint_upper[0, robot.front])

    def ways(_samples: int) -> int:
        way_m = (upper_m if out else 0.0) - robot.joint
        lines = drawer_grasps(robot, robot.ahead(way_m))[1]
        return max((len(line) for line in lines), default=0)

    def done() -> bool:
        return is_done(robot, DRAWER, out=out)

    def skill(robot: Robot) -> None:
        (open_drawer if out else close_drawer)(robot)
        # A drawer slides at a touch, and the robot stands beside it.
        for _ in range(BACK_STEPS):
            robot.drive(-0.5, 0.0)

    places = before_front(robot, robot.handle_m[:2], (0.55, 0.62, 0.7), 0.3)
    return at_work(robot, places, ways, skill, done)


def swing(robot: Robot, *, out: bool) -> bool:
    """Opens or closes the fridge."""

    def done() -> bool:
        return is_done(robot, FRIDGE, out=out)

    def skill(robot: Robot) -> None:
        hand = FridgeRobot(ThroughJoints(robot, done), robot.front)
        (open_fridge if out else close_fridge)(hand)
        robot.rest()

    fridge_m = np.asarray(robot.world.goals.front[0, robot.front, :2])
    places = before_front(robot, fridge_m, (1.2, 1.35, 1.5), 0.3)
    return at_work(robot, places, lambda _samples: 1, skill, done)


def is_done(robot: Robot, kind: FrontKind, *, out: bool) -> bool:
    """Whether the door or drawer is open, or closed, and the hand at rest."""
    upper = float(robot.world.goals.joint_upper[0, robot.front])
    share = robot.joint / upper
    moved = kind.is_open(robot.joint, share) if out else kind.is_closed(robot.joint)
    return bool(moved) and float(robot.core.measures.ee_to_rest_m[0]) < REST_RADIUS_M


def before_front(robot: Robot, point_m: np.ndarray, far_m: tuple, aside_m: float) -> Callable:
    """Returns (map) -> free base poses (K, 3) in a rectangle before a point (2,), facing it."""
    ahead = robot.ahead(1.0)[:2]

    def places(map_: NavigationMap) -> np.ndarray:
        poses = []
        for far in far_m:
            for aside in np.linspace(-aside_m, aside_m, 5):
                spot = point_m + far * ahead + aside * ahead[::-1] * (-1.0, 1.0)
                gap = point_m - spot
                if map_.is_free(spot):
                    poses.append((*spot, np.arctan2(gap[1], gap[0])))
        return np.array(poses).reshape(-1, 3)

    return places


class ThroughJoints:
    """Takes actions of ``ee_base`` to a robot that is driven in ``joint_target_base``.

    It says that the episode is over when what was to be done is done, or takes too long.
    """

    def __init__(self, robot: Robot, done: Callable[[], bool]) -> None:
        self._robot, self._done, self.unwrapped = robot, done, robot.core
        self._kinematics, self._last = ArmKinematics(), robot.steps + DOOR_STEPS

    def step(self, action: np.ndarray) -> tuple:
        """Moves the arm by the controller's own inverse kinematics."""
        robot, lower_m, upper_m = self._robot, np.array(EE_LOWER_M), np.array(EE_UPPER_M)
        before = robot.core.agent.controller.arm_target_rad[0].numpy().astype(float)
        robot.gripper = float(action[3])
        way_m = EE_STEP_M * action[:3].astype(float)
        robot.act(self._kinematics.move(before, way_m, lower_m, upper_m), tuple(action[4:]))
        over = robot.over or self._done() or robot.steps >= self._last
        return None, 0.0, over, False, robot.info
