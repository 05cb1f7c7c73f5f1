"""Start states of Pick (S H.2): objects settled on a receptacle, the robot facing the target.

Each episode draws only from its own generator, seeded by (dataset, split, env), seed and index.
Candidates that do not stand up to physics or cannot be reached are refused, with the reason.
"""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from transforms3d import quaternions

from hab_tasks.episodes.schema import Episode, RobotStart
from hab_tasks.episodes.spots import Spot, find_spots
from hab_tasks.episodes.workbench import START_CLEARANCE_M, Workbench
from hab_tasks.errors import GenerationError
from hab_tasks.geometry import Array, Pose7, pose, rotation_between
from hab_tasks.robots.fetch_spec import (
    ARM_LOWER_RAD,
    ARM_UPPER_RAD,
    EE_LOWER_M,
    EE_UPPER_M,
    REST_QPOS_RAD,
)
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.scenes.spec import ObjectTemplate, SceneSpec

GENERATOR_VERSION = 1
"""Goes up when the same seed gives other episodes; cached files of another version are not used."""


@dataclass(frozen=True, kw_only=True)
class PickStart:
    """Numbers of the start distribution; the noise is uniform within plus and minus its value."""

    base_noise_m: float = 0.1
    heading_noise_rad: float = math.radians(20.0)
    ee_noise_m: float = 0.05
    clutter: tuple[int, int] = (2, 5)
    base_clearance_m: float = 0.32
    nearest_base_m: float = 0.45
    farthest_base_m: float = 1.15
    settle_s: float = 4.0
    drop_m: float = 0.005
    moved_m: float = 0.05
    tilt_rad: float = 0.35
    base_candidates: int = 12
    reach_tries: int = 60
    reach_radius_m: float = 0.11


@dataclass(frozen=True, kw_only=True)
class Made:
    """A generated episode, and why candidates were refused."""

    episode: Episode
    rejections: Counter[str]


class _RefusedError(Exception):
    """A candidate that does not hold; its text is the reason that is counted."""


@dataclass
class PickGenerator:
    """Makes episodes of HabPick in the given layouts; keeps the last layout's workbench."""

    scenes: list[str]
    load: Callable[[str], SceneSpec]
    objects: dict[str, ObjectTemplate]
    start: PickStart = field(default_factory=PickStart)
    attempts: int = 200
    _bench: Workbench | None = None

    def __post_init__(self) -> None:
        self._kinematics = ArmKinematics()

    def generate(self, episode_id: str, seed: tuple[int, ...]) -> Made:
        """Makes one episode.

        Raises:
            GenerationError: Every attempt was refused; the message counts the reasons.
        """
        rng = np.random.default_rng(seed)
        refused: Counter[str] = Counter()
        scene_id = self.scenes[int(rng.integers(len(self.scenes)))]
        # A fresh scene for every episode: contact caches of an earlier one would leave traces.
        self._bench = Workbench(self.load(scene_id), self.objects)
        spots = find_spots(self._bench)
        if not spots:
            raise GenerationError(f"{episode_id}: {scene_id} has no receptacle for HabPick.")
        for _ in range(self.attempts):
            self._bench.clear()
            try:
                episode = self._attempt(rng, episode_id, scene_id, spots)
            except _RefusedError as reason:
                refused[str(reason)] += 1
                continue
            return Made(episode=episode, rejections=refused)
        raise GenerationError(
            f"{episode_id}: no start state in {scene_id}; refused: {dict(refused)}."
        )

    def _attempt(
        self, rng: np.random.Generator, episode_id: str, scene_id: str, spots: list[Spot]
    ) -> Episode:
        bench = self._require_bench()
        spot = spots[int(rng.integers(len(spots)))]
        for furniture, joints in spot.joints.items():
            for joint, value in joints.items():
                bench.set_joint(furniture, joint, value)
        placed = self._place_objects(rng, spot)
        stable = self._settled(placed)
        if not stable:
            raise _RefusedError("nothing stayed where it was put")
        target = stable[int(rng.integers(len(stable)))]
        for name in placed:
            if name not in stable:
                bench.place(name, (0.0, 0.0, -9.0, 1.0, 0.0, 0.0, 0.0))
        poses = {name: bench.pose(name) for name in sorted(stable)}
        robot = self._robot_start(rng, bench.com_m(target), poses)
        return Episode(
            id=episode_id,
            scene_id=scene_id,
            seed=int(rng.integers(2**31)),
            robot=robot,
            objects=poses,
            target=target,
            receptacle=(spot.receptacle.name, spot.receptacle.body),
            joints=spot.joints,
            loose=bench.settled,
        )

    def _place_objects(self, rng: np.random.Generator, spot: Spot) -> dict[str, Pose7]:
        """Stands the target-to-be and clutter side by side on the spot."""
        bench, start = self._require_bench(), self.start
        wanted = 1 + int(rng.integers(start.clutter[0], start.clutter[1] + 1))
        names = [str(name) for name in rng.permutation(sorted(self.objects))]
        taken: list[tuple[Array, float]] = []
        placed: dict[str, Pose7] = {}
        for name in names:
            if len(placed) == wanted:
                break
            middle, radius, depth = bench.footprint(name)
            point = spot.sample(rng, radius, taken)
            if point is None:
                continue
            yaw = rng.uniform(-math.pi, math.pi)
            turn = quaternions.axangle2quat([0.0, 0.0, 1.0], yaw)
            upright = rotation_between(np.array(self.objects[name].up), np.array([0.0, 0.0, 1.0]))
            q = quaternions.qmult(turn, upright)
            above = np.array([0.0, 0.0, depth + start.drop_m])
            placed[name] = pose(point + above - quaternions.rotate_vector(middle, q), q)
            taken.append((point, radius))
            bench.place(name, placed[name])
        if not placed:
            raise _RefusedError("no room on the receptacle")
        return placed

    def _settled(self, placed: dict[str, Pose7]) -> list[str]:
        """Runs physics; returns the objects that stayed upright where they were put, sorted."""
        bench, start = self._require_bench(), self.start
        bench.settle(start.settle_s, tuple(placed))
        stable = []
        for name, before in sorted(placed.items()):
            after = bench.pose(name)
            moved = float(np.linalg.norm(np.subtract(after[:3], before[:3])))
            turned = 2 * math.acos(min(1.0, abs(float(np.dot(after[3:], before[3:])))))
            if moved < start.moved_m and turned < start.tilt_rad:
                stable.append(name)
        return stable

    def _robot_start(
        self, rng: np.random.Generator, target_m: Array, poses: dict[str, Pose7]
    ) -> RobotStart:
        """Stands the robot on the nearest free floor from which the target can be reached."""
        bench, start = self._require_bench(), self.start
        floor = bench.floor()
        cells = floor.cells_by_distance(target_m, start.base_clearance_m, start.nearest_base_m)
        near = cells[np.linalg.norm(cells - target_m[:2], axis=1) < start.farthest_base_m]
        if not len(near):
            raise _RefusedError("no free floor near the target")
        reason = "target out of reach"
        for cell in near[:: max(1, len(near) // start.base_candidates)]:
            noise = rng.uniform(-1.0, 1.0, 6)
            base = self._base(cell, target_m, noise)
            arm = self._noisy_arm(noise[3:])
            if arm is None or bench.robot_touches(base, arm, START_CLEARANCE_M):
                reason = "robot too close to something at its start"
                continue
            if self._reaches(rng, base, target_m):
                bench.send_robot_away()
                return RobotStart(base=base, arm_qpos_rad=tuple(float(x) for x in arm))
            for name, where in poses.items():
                bench.place(name, where)
        raise _RefusedError(reason)

    def _base(self, cell: Array, target_m: Array, noise: Array) -> tuple[float, float, float]:
        x, y = cell + self.start.base_noise_m * noise[:2]
        facing = math.atan2(target_m[1] - y, target_m[0] - x)
        return float(x), float(y), float(facing + self.start.heading_noise_rad * noise[2])

    def _noisy_arm(self, noise: Array) -> Array | None:
        """Returns the rest pose with the end-effector displaced by the noise; None off limits."""
        rest = np.array(REST_QPOS_RAD)
        goal = self._kinematics.position(rest) + self.start.ee_noise_m * noise
        return self._solve(rest, goal)

    def _reaches(
        self, rng: np.random.Generator, base: tuple[float, float, float], target_m: Array
    ) -> bool:
        """Whether some arm pose brings the hand into grasping range without touching anything."""
        bench, start = self._require_bench(), self.start
        offset = target_m[:2] - np.array(base[:2])
        c, s = math.cos(base[2]), math.sin(base[2])
        local = np.array(
            [c * offset[0] + s * offset[1], c * offset[1] - s * offset[0], target_m[2]]
        )
        slack = start.reach_radius_m
        if (local < np.array(EE_LOWER_M) - slack).any() or (
            local > np.array(EE_UPPER_M) + slack
        ).any():
            return False
        for _ in range(start.reach_tries):
            direction = rng.normal(size=3)
            goal = local + start.reach_radius_m * direction / np.linalg.norm(direction)
            arm = self._solve(rng.uniform(ARM_LOWER_RAD, ARM_UPPER_RAD), goal)
            if arm is not None and not bench.robot_touches(base, arm):
                return True
        return False

    def _solve(self, arm: Array, goal_m: Array) -> Array | None:
        for _ in range(40):
            arm = self._kinematics.displace(arm, goal_m, damping=0.05)
        close = np.linalg.norm(self._kinematics.position(arm) - goal_m) < 0.005
        return arm if close else None

    def _require_bench(self) -> Workbench:
        assert self._bench is not None
        return self._bench


def stable_hash(*names: str) -> int:
    """Returns a number made from names, the same on every machine and in every run."""
    return zlib.crc32("\0".join(names).encode())
