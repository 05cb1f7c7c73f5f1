"""Scripted robots that see everything, one for each skill: what a skill asks for can be done.

The arm is driven in ``joint_target``, along ways that SPA-Priv's planner finds between the
simulator's own shapes; the base by its cells, or by its velocities where a task moves both.
"""

from dataclasses import replace

import numpy as np
from hab_spa.arm_plan import Ends, PlanConfig, plan_path
from hab_spa.collision import ArmCollision, ShapeCache
from hab_spa.ik import LOWER_RAD, UPPER_RAD, BatchArm, IkConfig
from hab_spa.joint_goal import GoalConfig, sample_rest_goals, would_grasp
from hab_spa.path import TimingConfig, time_path_within
from hab_spa.pick import Phase, PickConfig, PickSkill
from hab_spa.shapes import invert_pose

from hab_tasks.constants import CONTROL_HZ, REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.navigation import path_between
from hab_tasks.robots.control import BASE_CELLS
from hab_tasks.robots.fetch_spec import BASE_ANGULAR_SPEED_RAD_S, REST_QPOS_RAD

LET_GO, GRASP = -1.0, 1.0
SAMPLES = 400
LINE_STEP_M = 0.015
PLAN, TRIES = PlanConfig(time_limit_s=8.0), 2
ARRIVED_M, ARRIVED_RAD = 0.12, 0.15
STUCK_STEPS = 5
TURN_STEP_RAD = BASE_ANGULAR_SPEED_RAD_S / CONTROL_HZ
ROUNDS, SLACK_M = 2, 0.03
"""How often a handle is taken anew, and what may remain of a drawer's way."""


class Robot:
    """Steps one environment and remembers how that went.

    Attributes:
        object: Number of the object it is about.
        front: Number of the door or drawer.
        gripper: Entry of every action until it is changed.
        info: What the last step said.
        over: Whether the episode has ended.
        steps: How many actions were carried out.
    """

    def __init__(self, env) -> None:
        self.core, self.env = env.unwrapped, env
        self.object, self.front = 0, 0
        self.steps, self.over, self.info = 0, False, {}
        self.kinematics, self.shapes = BatchArm(), ShapeCache()
        self._rng = np.random.default_rng(0)
        self._target_rad = self.qpos
        holds = int(self.shot.held[0]) >= 0 or int(self.shot.held_handle[0]) >= 0
        self.gripper = GRASP if holds else LET_GO

    # What there is -----------------------------------------------------------------------------

    @property
    def world(self):
        """The simulated world."""
        return self.core._world

    @property
    def shot(self):
        """The latest snapshot."""
        return self.world.snapshot

    @property
    def qpos(self) -> np.ndarray:
        """The arm (7,) [rad]."""
        return np.asarray(self.shot.arm_qpos_rad[0], dtype=float)

    @property
    def base(self) -> np.ndarray:
        """x, y, yaw (3,) of the base."""
        return np.asarray(self.shot.base[0], dtype=float)

    @property
    def episode(self):
        """What is played."""
        return self.world.episodes[0]

    @property
    def target(self) -> str:
        """Handle of the object it is about."""
        return self.episode.targets[self.object].object

    @property
    def goal_m(self) -> np.ndarray:
        """Where that object's centre of mass (3,) is to be."""
        return np.asarray(self.world.goals.goals_m[0, self.object], dtype=float)

    @property
    def handle_m(self) -> np.ndarray:
        """The handle (3,) of the door or drawer it is about."""
        return np.asarray(self.shot.handles_m[0, self.front], dtype=float)

    @property
    def joint(self) -> float:
        """The position of that door or drawer."""
        return float(self.shot.joints[0, self.front])

    def state(self, without: str | None = None):
        """Returns the true state, except for the body `without`."""
        state = self.core.privileged()[0]
        poses = {name: pose for name, pose in state.world_from_body.items() if name != without}
        return replace(state, target=self.target, world_from_body=poses)

    def collision(self, without: str | None = None) -> ArmCollision:
        """Returns the arm's collision model, with what is held; `without` leaves a body out."""
        state = self.state(without)
        return ArmCollision(state, held=state.held, cache=self.shapes)

    def in_arm(self, points_m) -> np.ndarray:
        """Returns world points (P, 3) in the arm's root frame."""
        arm_from_world = invert_pose(self.state().world_from_base)
        return np.asarray(points_m) @ arm_from_world[:3, :3].T + arm_from_world[:3, 3]

    # Moving ------------------------------------------------------------------------------------

    def act(self, target_rad=None, base=(0.0, 0.0)) -> None:
        """Moves the arm to a pose (7,), the last one for None; nothing when the episode is over."""
        if self.over:
            return
        if target_rad is not None:
            self._target_rad = np.asarray(target_rad)
        action = np.concatenate((self._target_rad, [self.gripper], base))
        self._step(action[: self.env.action_space.shape[0]].astype(np.float32))

    def drive(self, forward: float, turn: float) -> None:
        """Moves the base at shares of its largest speeds."""
        if self.env.action_space.shape:
            self.act(base=(forward, turn))
        elif not self.over:
            gaps = np.linalg.norm(np.array(BASE_CELLS) - (forward, turn), axis=1)
            self._step(int(gaps.argmin()))

    def _step(self, action) -> None:
        _, _, terminated, truncated, self.info = self.env.step(action)
        self.steps += 1
        self.over = bool(terminated) or bool(truncated)

    def follow(self, path, share: float = 1.0) -> None:
        """Moves the arm along poses (K, 7), no faster than a share of the time left demands."""
        left = int((self.core.horizon_steps - self.steps - 10) * share)
        for target in time_path_within(np.asarray(path), left, TimingConfig()):
            self.act(target)
        for _ in range(3):
            self.act()

    def relax(self, steps: int) -> None:
        """Makes the present pose the commanded one."""
        self.act(self.qpos)
        for _ in range(steps - 1):
            self.act()

    def reaching(self, collision: ArmCollision, points_m, samples: int = SAMPLES) -> np.ndarray:
        """Returns free arm poses (G, 7) with the hand at one of the world points (P, 3).

        The nearest to the present pose comes first.
        """
        if not len(points_m):
            return np.zeros((0, 7))
        targets = self.in_arm(points_m)[self._rng.integers(len(points_m), size=samples)]
        starts = self._rng.uniform(LOWER_RAD, UPPER_RAD, (samples, 7))
        starts[: samples // 4] = self.qpos
        found, reached = self.kinematics.solve(starts, targets, IkConfig())
        found = found[reached]
        found = found[np.argsort(np.linalg.norm(found - self.qpos, axis=1))]
        for margin_m in GoalConfig().margins_m:
            collision.set_margin(margin_m)
            free = [pose for pose in found if collision.is_free(pose)]
            if free:
                return np.array(free)
        return np.zeros((0, 7))

    def move(self, collision: ArmCollision, goals, *, leaving: bool = False) -> bool:
        """Plans to one of arm poses (G, 7) and goes there; whether there is a way.

        `leaving` a tight place, the planner starts from the other end.
        """
        here = self.qpos
        ends = [
            Ends(open=goal, tight=here) if leaving else Ends(open=here, tight=goal)
            for goal in apart(goals)
        ]
        for seed in range(TRIES if ends else 0):
            path = plan_path(collision, self.kinematics, ends, seed, PLAN, 0.004).path
            if path is not None:
                self.follow(path[::-1] if leaving else path, 1.0 if leaving else 0.5)
                return True
        return False

    def rest(self, without: str | None = None) -> bool:
        """Brings the hand to rest; whether there is a way."""
        collision = self.collision(without)
        goals = sample_rest_goals(collision, self.kinematics, 0, GoalConfig()).goals
        return self.move(collision, goals, leaving=True)

    def line(self, pose_rad, way_m, collision: ArmCollision) -> np.ndarray:
        """Returns arm poses (K, 7) along a straight way of the hand, a world vector (3,).

        It ends where the arm cannot follow or touches something.
        """
        way = invert_pose(self.state().world_from_base)[:3, :3] @ np.asarray(way_m, dtype=float)
        count = max(1, round(float(np.linalg.norm(way)) / LINE_STEP_M))
        goal, poses = self.kinematics.ee_pose(pose_rad).copy(), [np.asarray(pose_rad)]
        for _ in range(count):
            goal[:3, 3] += way / count
            pose = self.kinematics.track_pose(poses[-1], goal, steps=3, turn_weight_m=0.05)
            missed_m = np.linalg.norm(self.kinematics.ee_pose(pose)[:3, 3] - goal[:3, 3])
            if missed_m > 0.01 or not collision.is_free(pose):
                break
            poses.append(pose)
        return np.array(poses)


def apart(poses) -> list[np.ndarray]:
    """Returns the first few arm poses (7,) that differ from one another."""
    chosen: list[np.ndarray] = []
    for pose in poses:
        if all(np.abs(pose - other).max() > 0.3 for other in chosen):
            chosen.append(pose)
    return chosen[:4]


def around(point_m, radius_m: float, count: int = 60) -> np.ndarray:
    """Returns points (P, 3) on a sphere."""
    directions = np.random.default_rng(0).normal(size=(count, 3))
    return point_m + radius_m * directions / np.linalg.norm(directions, axis=1, keepdims=True)


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
    yaw = float(robot.world.goals.front[0, robot.front, 2])
    way = way_m * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    grasps, lines = _drawer_grasps(robot, way)
    if not robot.move(robot.collision(), grasps):
        return False
    robot.gripper = GRASP
    for _ in range(3):
        robot.act()
    nearest = np.linalg.norm(grasps - robot.qpos, axis=1).argmin()
    robot.follow(lines[nearest])
    robot.relax(3)
    robot.gripper = LET_GO
    robot.relax(2)
    return True


def drawer_of(robot: Robot) -> str:
    """Returns the name of the body that the handle is fixed to."""
    handle = robot.world._grasp.handles[int(robot.world.tracker.handles[0, robot.front])]
    return f"{handle.furniture_name}/{handle.link.name}"


def _drawer_grasps(robot: Robot, way_m) -> tuple[np.ndarray, list[np.ndarray]]:
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
        if robot.move(collision, _drops(robot, collision, height_m)):
            break
    robot.relax(4)
    robot.gripper = LET_GO
    robot.relax(4)
    # What was let go touches the hand; it counts as an obstacle only where nothing else is tight.
    robot.rest(without=robot.target)


def _drops(robot: Robot, collision: ArmCollision, height_m: float) -> np.ndarray:
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
    for pose in robot.reaching(collision, points):
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


def drive_to(robot: Robot, map_, goal, steps: int = 450) -> bool:
    """Drives to a base pose (3,); whether it got there."""
    goal = np.asarray(goal, dtype=float)
    stuck = 0
    for _ in range(steps):
        here = robot.base
        gap_m = float(np.linalg.norm(goal[:2] - here[:2]))
        turn = _between(goal[2], here[2])
        if robot.over or (gap_m < ARRIVED_M and abs(turn) < ARRIVED_RAD):
            break
        if gap_m < ARRIVED_M:
            forward, turning = 0.0, turn / TURN_STEP_RAD
        else:
            forward, turning = _along(path_between(map_, here[:2], goal[:2]), here)
        robot.drive(forward, float(np.clip(turning, -1.0, 1.0)))
        moved = robot.base - here
        still = np.linalg.norm(moved[:2]) < 0.003 and abs(_between(moved[2], 0.0)) < 0.01
        stuck = stuck + 1 if still else 0
        if stuck >= STUCK_STEPS:
            stuck = 0
            # The arm, which the map leaves out, has met something.
            for _ in range(8):
                robot.drive(-0.5, 0.0)
    return gap_m < ARRIVED_M


def _along(path: np.ndarray, here: np.ndarray) -> tuple[float, float]:
    """Returns forward and turning speed, as shares, towards the next point of a path (W, 2)."""
    lengths = np.linalg.norm(path - here[:2], axis=1)
    ahead = next((p for p, far in zip(path, lengths, strict=True) if far > 0.1), path[-1])
    turn = _between(np.arctan2(*(ahead - here[:2])[::-1]), here[2])
    if abs(turn) > 0.3:
        return 0.0, turn / TURN_STEP_RAD
    return (1.0 if len(path) > 2 or lengths[-1] > 0.3 else 0.5), turn / TURN_STEP_RAD


def _between(to_rad: float, from_rad: float) -> float:
    """Returns the smallest turn [rad] from one heading to another."""
    return float((to_rad - from_rad + np.pi) % (2 * np.pi) - np.pi)
