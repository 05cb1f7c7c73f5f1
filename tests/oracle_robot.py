"""A scripted robot that sees everything, and plans with it.

The arm is driven in ``joint_target``, along ways that SPA-Priv's planner finds between the
simulator's own shapes; the base by its cells, or by its velocities where a task moves both.
"""

from dataclasses import replace

import numpy as np
from hab_spa.arm_plan import Ends, PlanConfig, plan_path
from hab_spa.collision import ArmCollision, ShapeCache
from hab_spa.ik import LOWER_RAD, UPPER_RAD, BatchArm, IkConfig
from hab_spa.joint_goal import GoalConfig, sample_rest_goals
from hab_spa.path import TimingConfig, time_path_within
from hab_spa.shapes import invert_pose

from hab_tasks.geometry import compose, inverse, planar, to_matrix
from hab_tasks.robots.control_modes import BASE_CELLS

LET_GO, GRASP = -1.0, 1.0
SAMPLES = 400
LINE_STEP_M = 0.015
PLAN, TRIES = PlanConfig(time_limit_s=8.0), 2


class Robot:
    """Steps one environment and remembers how that went.

    Attributes:
        object: Number of the object it is about.
        front: Number of the door or drawer.
        gripper: Entry of every action until it is changed.
        info: What the last step said.
        over: Whether the episode has ended.
        steps: How many actions were carried out.
        imagined: A base pose (3,) where the robot is thought to be; None for where it is.
    """

    def __init__(self, env) -> None:
        self.core, self.env = env.unwrapped, env
        self.object, self.front = 0, 0
        self.imagined: np.ndarray | None = None
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

    def ahead(self, way_m: float) -> np.ndarray:
        """Returns a way (3,) straight out of that piece of furniture."""
        yaw = float(self.world.goals.front[0, self.front, 2])
        return way_m * np.array((np.cos(yaw), np.sin(yaw), 0.0))

    def state(self, without: str | None = None):
        """Returns the true state, except for the body `without`."""
        state = self.core.privileged()[0]
        poses = {name: pose for name, pose in state.world_from_body.items() if name != without}
        state = replace(state, target=self.target, world_from_body=poses)
        return state if self.imagined is None else self._moved(state, self.imagined)

    def _moved(self, state, base: np.ndarray):
        """Returns a state with the robot, and what it holds, at another base pose (3,)."""
        way = to_matrix(compose(planar(*base), inverse(planar(*self.base))))
        points = dict(state.object_com_m)
        if state.held:
            points[state.held] = (way @ np.append(points[state.held], 1.0))[:3]
        own = {name for name in state.world_from_body if name.startswith("hab_fetch/")}
        poses = {
            name: way @ pose if name in own | {state.held} else pose
            for name, pose in state.world_from_body.items()
        }
        return replace(
            state,
            world_from_body=poses,
            world_from_base=way @ state.world_from_base,
            object_com_m=points,
        )

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
