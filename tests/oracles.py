"""Scripted robots, one for each skill: what a skill asks for can be done."""

import numpy as np
from hab_spa.arm_plan import Ends, plan_path
from hab_spa.collision import ArmCollision
from hab_spa.joint_goal import GoalConfig, would_grasp
from hab_spa.pick import Phase, PickConfig, PickSkill
from hab_spa.shapes import invert_pose
from oracle_robot import GRASP, LET_GO, SAMPLES, TRIES, Robot, apart, around

from hab_tasks.constants import CONTROL_HZ, REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.navigation import path_between
from hab_tasks.robots.fetch_spec import (
    BASE_ANGULAR_SPEED_RAD_S,
    BASE_LINEAR_SPEED_M_S,
    REST_QPOS_RAD,
)

ROUNDS, SLACK_M = 2, 0.03
"""How often a handle is taken anew, and what may remain of a drawer's way."""

ARRIVED_M, ARRIVED_RAD = 0.12, 0.15
STUCK_STEPS = 5
STEP_M = BASE_LINEAR_SPEED_M_S / CONTROL_HZ
STEP_RAD = BASE_ANGULAR_SPEED_RAD_S / CONTROL_HZ

# Drawers ---------------------------------------------------------------------------------------


def open_drawer(robot: Robot) -> None:
    """Takes the handle, pulls the drawer out, lets go, and rests."""
    _slide_drawer(robot, float(robot.world.goals.joint_upper[0, robot.front]))


def close_drawer(robot: Robot) -> None:
    """Takes the handle, pushes the drawer in, lets go, and rests."""
    _slide_drawer(robot, 0.0)


def _slide_drawer(robot: Robot, to_m: float) -> None:
    """Moves a drawer by the handle, and takes it anew where the arm did not get it all the way."""
    for _ in range(ROUNDS):
        if abs(to_m - robot.joint) > SLACK_M and not _slide_once(robot, to_m - robot.joint):
            break
    # Beside an open drawer the planner may find no way out that keeps clear of it.
    if not robot.rest():
        robot.rest(without=drawer_of(robot))


def _slide_once(robot: Robot, way_m: float) -> bool:
    way = robot.ahead(way_m)
    grasps, lines = drawer_grasps(robot, way)
    if not robot.move(robot.collision(), grasps):
        return False
    robot.gripper = GRASP
    for _ in range(3):
        robot.act()
    nearest = np.linalg.norm(grasps - robot.qpos, axis=1).argmin()
    robot.follow(lines[nearest])
    robot.relax(10)
    robot.gripper = LET_GO
    robot.relax(2)
    return True


def drawer_of(robot: Robot) -> str:
    """Returns the name of the body that the handle is fixed to."""
    handle = robot.world._grasp.handles[int(robot.world.tracker.handles[0, robot.front])]
    return f"{handle.furniture_name}/{handle.link.name}"


def drawer_grasps(robot: Robot, way_m) -> tuple[np.ndarray, list[np.ndarray]]:
    """Returns arm poses (G, 7) that take a handle, and the lines (K, 7) that move it farthest."""
    still, moving = robot.collision(), robot.collision(without=drawer_of(robot))
    moving.set_margin(0.0)
    found = []
    for radius_m in (0.05, 0.08, 0.12):
        poses = robot.reaching(still, around(robot.handle_m, radius_m))
        still.set_margin(0.002)
        for pose in poses[:60]:
            goal = robot.kinematics.ee_pose(pose).copy()
            goal[:3, 3] = robot.in_arm(robot.handle_m[None])[0]
            # The grasp pulls hand and handle together.
            held = robot.kinematics.track_pose(pose, goal, steps=6, turn_weight_m=0.02)
            if still.is_free(held):
                found.append((pose, robot.line(held, way_m, moving)))
    longest = max((len(line) for _, line in found), default=0)
    best = [entry for entry in found if len(entry[1]) >= longest - 1][:4]
    return np.array([pose for pose, _ in best]).reshape(-1, 7), [line for _, line in best]


# Pick and place ----------------------------------------------------------------------------------


class ThoroughPick(PickSkill):
    """SPA-Priv's Pick; in tight places it also tries grasps from all around, and plans longer."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(0, PickConfig(retries=4), robot.shapes)
        self._robot = robot

    @property
    def stopped(self) -> bool:
        """Whether it has given up."""
        return self._phase is Phase.STOPPED

    def _plan_reach(self, state) -> None:
        super()._plan_reach(state)
        if self._phase is not Phase.STOPPED:
            return
        robot, collision = self._robot, self._robot.collision()
        grasps = robot.reaching(collision, grasp_points(robot), 40 * SAMPLES)
        grasps = grasps[np.argsort(np.linalg.norm(grasps - REST_QPOS_RAD, axis=1))]
        ends = [Ends(open=state.arm_qpos.copy(), tight=grasp) for grasp in apart(grasps)]
        if ends:
            path = plan_path(collision, self._arm, ends, self._next_seed(), self._config.plan)
            self._start(path, Phase.REACH)

    def _plan_return(self, state) -> None:
        for _ in range(TRIES):
            self._enter(Phase.PLAN_RETURN)
            self._phase_steps = self._config.hold_steps
            super()._plan_return(state)
            if self._phase is not Phase.STOPPED:
                return


def pick(robot: Robot) -> None:
    """Takes the target and rests."""
    skill = ThoroughPick(robot)
    for _ in range(SKILL_HORIZON_STEPS):
        state = robot.state()
        target_rad, robot.gripper = skill.act(state)
        robot.act(target_rad)
        resting = float(robot.core.measures.ee_to_rest_m[0]) < REST_RADIUS_M
        if robot.over or skill.stopped or (state.held == robot.target and resting):
            return


def grasp_points(robot: Robot) -> np.ndarray:
    """Returns points (P, 3) at which the hand takes the target and nothing else."""
    state = robot.state()
    com_m = state.object_com_m[robot.target]
    points = np.concatenate([around(com_m, radius_m) for radius_m in (0.04, 0.08, 0.12, 0.138)])
    return points[would_grasp(state, points, GoalConfig())]


def place(robot: Robot) -> None:
    """Brings what is held as low over its goal as it can, lets go, and rests."""
    for height_m in (0.0, 0.02, 0.04, 0.08, 0.12):
        collision = robot.collision()
        if robot.move(collision, drops(robot, collision, height_m, 5 * SAMPLES)):
            break
    robot.relax(4)
    robot.gripper = LET_GO
    robot.relax(4)
    # What was let go touches the hand; it counts as an obstacle only where nothing else is tight.
    robot.rest(without=robot.target)


def drops(
    robot: Robot, collision: ArmCollision, height_m: float, samples: int = SAMPLES
) -> np.ndarray:
    """Returns free arm poses (G, 7) with what is held at its goal, or so much above.

    The most upright come first.
    """
    state = robot.state()
    ee = robot.kinematics.ee_pose(robot.qpos)
    com = np.append(robot.in_arm(state.object_com_m[robot.target][None])[0], 1.0)
    in_hand = invert_pose(ee) @ com
    over_m = robot.goal_m + np.array((0.0, 0.0, height_m))
    goal = robot.in_arm(over_m[None])[0]
    up = ee[:3, :3].T @ [0.0, 0.0, 1.0]
    radius_m = float(np.linalg.norm(in_hand[:3]))
    points = around(over_m, max(radius_m, 0.02))
    found = []
    for pose in robot.reaching(collision, points, samples):
        hand = robot.kinematics.ee_pose(pose)
        missed = (hand @ in_hand)[:3] - goal
        if np.linalg.norm(missed[:2]) < 0.06 and 0 <= missed[2] + 0.03 < 0.08:
            found.append((float((hand[:3, :3] @ up)[2]), pose))
    found.sort(key=lambda entry: -entry[0])
    return np.array([pose for _, pose in found]).reshape(-1, 7)


# Navigate ----------------------------------------------------------------------------------------


def navigate(robot: Robot) -> None:
    """Drives to the base's goal, turns, and stops there."""
    drive_to(robot, robot.world.maps.of(robot.episode), np.asarray(robot.world.goals.base[0]))
    robot.drive(0.0, 0.0)


def drive_to(robot: Robot, map_, goal, *, within_m: float = ARRIVED_M, steps: int = 450) -> bool:
    """Drives to a base pose (3,); whether it got there."""
    goal, still = np.asarray(goal, dtype=float), 0
    for _ in range(steps):
        here = robot.base
        gap_m = float(np.linalg.norm(goal[:2] - here[:2]))
        turn = between(goal[2], here[2])
        if robot.over or (gap_m < within_m and abs(turn) < ARRIVED_RAD):
            return not robot.over
        if gap_m < within_m:
            forward, turning = 0.0, turn / STEP_RAD
        else:
            forward, turning = _along(path_between(map_, here[:2], goal[:2]), here)
        robot.drive(forward, float(np.clip(turning, -1.0, 1.0)))
        way = robot.base - here
        moves = np.linalg.norm(way[:2]) > 0.003 or abs(between(way[2], 0.0)) > 0.01
        still = 0 if moves else still + 1
        if still == STUCK_STEPS:
            still = 0
            # The arm, which the map leaves out, has met something.
            for _ in range(8):
                robot.drive(-0.5, 0.0)
    return False


def _along(path: np.ndarray, here: np.ndarray) -> tuple[float, float]:
    """Returns forward and turning speed, as shares, towards the next point of a path (W, 2)."""
    lengths = np.linalg.norm(path - here[:2], axis=1)
    ahead = next((p for p, far in zip(path, lengths, strict=True) if far > 0.1), path[-1])
    turn = between(np.arctan2(*(ahead - here[:2])[::-1]), here[2])
    if abs(turn) > 0.3:
        return 0.0, turn / STEP_RAD
    speed = 1.0 if len(path) > 2 else max(0.3, min(1.0, lengths[-1] / (4 * STEP_M)))
    return speed, turn / STEP_RAD


def between(to_rad: float, from_rad: float) -> float:
    """Returns the smallest turn [rad] from one heading to another."""
    return float((to_rad - from_rad + np.pi) % (2 * np.pi) - np.pi)
