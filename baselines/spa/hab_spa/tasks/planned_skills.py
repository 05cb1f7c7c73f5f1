"""Skills of a task by sense-plan-act, as providers of a plan's executor, and their base poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np
from hab_plans.motion import Motion
from hab_plans.protocols import BasePose
from hab_plans.stage import Stage

from hab_spa.motion.moves import go, tucked_rad
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_spa.skills.drawer import (
    DrawerConfig,
    close_drawer,
    drawer_base_poses,
    drawer_score,
    open_drawer,
)
from hab_spa.skills.friction_drawer import CLOSE as CLOSE_DRAWER
from hab_spa.skills.friction_drawer import (
    close_drawer_by_friction,
    friction_drawer_score,
    open_drawer_by_friction,
)
from hab_spa.skills.friction_fridge import (
    CLOSE_ON,
    OPEN,
    open_fridge_by_friction,
    push_fridge_closed,
)
from hab_spa.skills.friction_pick import friction_pick_score, pick_by_friction
from hab_spa.skills.fridge.config import FridgeConfig
from hab_spa.skills.fridge.skill import close_fridge, fridge_base_poses, fridge_score, open_fridge
from hab_spa.skills.pick import pick, pick_score
from hab_spa.skills.place import place, place_score
from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.world.navigation import NavigationMap, poses_reaching

Score = Callable[[Array, int], float]
"""(base pose (3,), effort) -> number of solutions found from there; 0 if the pose is useless."""

SAME_ARM_RAD = 0.1
"""Maximum joint error of an arm that is already in the required pose."""


@dataclass(frozen=True, kw_only=True)
class StandingConfig:
    """Parameters of base pose selection.

    Attributes:
        base_poses: Number of base poses scored, from the better half of the candidates.
        more_base_poses: Number scored from all candidates if none of those is feasible.
        effort: Effort of the final round of scoring.
        enough_score: A base pose with this score is accepted immediately.
        apart_m: Minimum distance from base poses tried before.
    """

    base_poses: int = 16
    more_base_poses: int = 60
    effort: int = 6
    enough_score: float = 12
    apart_m: float = 0.12


def choose(
    robot: Robot, poses: Array, score: Score, tried: Sequence[BasePose], config: StandingConfig
) -> BasePose | None:
    """Returns the best-scored base pose for a skill.

    Args:
        robot: The robot, its arm at rest.
        poses: Candidates (K, 3), best first.
        score: Scores them.
        tried: Base poses that have failed.
        config: Parameters.
    """
    for other in tried:
        poses = poses[np.linalg.norm(poses[:, :2] - other.base[:2], axis=1) >= config.apart_m]
    few = spread(np.array_split(poses, 2)[0], config.base_poses)
    more = spread(poses, config.more_base_poses)
    arms = (robot.scene.arm_qpos.copy(), tucked_rad(robot.scene.robot))
    for (some, effort), arm_rad in product(((few, 1), (more, 1), (more, config.effort)), arms):
        best, highest = None, 0.0
        for pose, value in _scored(robot, score, some, arm_rad, effort):
            if value > highest:
                best, highest = pose, value
            if highest >= config.enough_score:
                break
        if best is not None:
            return BasePose(base=best, arm_rad=arm_rad)
    return None


def spread(poses: Array, count: int) -> Array:
    """Returns about `count` of the poses (K, 3), at regular intervals."""
    return poses[:: max(1, len(poses) // count)]


def _scored(
    robot: Robot, score: Score, poses: Array, arm_rad: Array, effort: int
) -> Iterator[tuple[Array, float]]:
    """Yields the base poses (3,) at which the arm is collision-free, with their scores."""
    for pose in poses:
        if robot.scene.collision(base=pose).is_free(arm_rad):
            yield pose, score(pose, effort)


def fold(robot: Robot, standing: BasePose) -> Motion:
    """Moves the arm to the pose for driving to a base pose."""
    gap_rad = np.abs(robot.scene.arm_qpos - standing.arm_rad).max()
    if gap_rad <= SAME_ARM_RAD:
        return None
    robot.doing = "fold"
    return (yield from go(robot, robot.scene.collision(), standing.arm_rad[None]))


NEAREST_M, FARTHEST_M = 0.4, 1.35
"""Horizontal distance from the base at which the arm can pick or place."""


SkillMotion = Callable[[Robot, int], Motion]
"""(robot, number of the object, door or drawer) -> motion."""


@dataclass(frozen=True, kw_only=True)
class PlannedSkill:
    """A skill.

    Attributes:
        motion: Starts the skill.
        base_poses: (robot, number, map) -> candidate base poses (K, 3), best first.
        score: (robot, number, map) -> scoring function of base poses.
        standing: Parameters of base pose selection.
    """

    motion: SkillMotion
    base_poses: Callable[[Robot, int, NavigationMap], Array]
    score: Callable[[Robot, int, NavigationMap], Score]
    standing: StandingConfig = field(default_factory=StandingConfig)

    name = "spa_priv"
    horizon_steps = SKILL_HORIZON_STEPS
    knows_effect = True

    def can_start(self, robot: Robot, stage: Stage) -> bool:
        """Returns True: what cannot start fails by itself."""
        return True

    def base_pose(self, robot: Robot, stage: Stage, tried: Sequence[BasePose]) -> BasePose | None:
        """Returns the base pose with the best score, apart from those tried."""
        number, map_ = stage.number, robot.scene.floor_map()
        poses, score = self.base_poses(robot, number, map_), self.score(robot, number, map_)
        return choose(robot, poses, score, tried, self.standing)

    def start_of(self, robot: Robot, stage: Stage) -> None:
        """Returns None: planning knows no training."""

    def start(self, robot: Robot, stage: Stage) -> Motion:
        """Returns the motion."""
        return self.motion(robot, stage.number)


def _around_object(robot: Robot, number: int, map_: NavigationMap) -> Array:
    return poses_reaching(map_, robot.scene.object_m(number), NEAREST_M, FARTHEST_M)


def _around_goal(robot: Robot, number: int, map_: NavigationMap) -> Array:
    return poses_reaching(map_, robot.scene.goal_m(number), NEAREST_M, FARTHEST_M)


def _drawer_score(
    robot: Robot, number: int, map_: NavigationMap, score: Callable[..., int], out: bool
) -> Score:
    return lambda base, _effort: score(robot, number, base, out)


def _fridge_score(
    robot: Robot, number: int, map_: NavigationMap, out: bool, config: FridgeConfig | None
) -> Score:
    score = fridge_score(robot, number, map_, out, config)
    return lambda base, _effort: score(base)


def _drawer(
    motion: SkillMotion,
    score: Callable[..., int],
    out: bool,
    standing: StandingConfig | None = None,
    config: DrawerConfig | None = None,
) -> PlannedSkill:
    return PlannedSkill(
        motion=motion,
        base_poses=partial(drawer_base_poses, config=config),
        score=partial(_drawer_score, score=score, out=out),
        standing=standing or StandingConfig(),
    )


def _fridge(motion: SkillMotion, out: bool, config: FridgeConfig | None = None) -> PlannedSkill:
    return PlannedSkill(
        motion=motion,
        base_poses=partial(fridge_base_poses, out=out, config=config),
        score=partial(_fridge_score, out=out, config=config),
    )


PICK = PlannedSkill(
    motion=pick,
    base_poses=_around_object,
    score=lambda robot, number, _map: partial(pick_score, robot, number),
)
PLACE = PlannedSkill(
    motion=place,
    base_poses=_around_goal,
    score=lambda robot, number, _map: partial(place_score, robot, number),
)
SKILLS = {
    "pick": PICK,
    "place": PLACE,
    "open_drawer": _drawer(open_drawer, drawer_score, True),
    "close_drawer": _drawer(close_drawer, drawer_score, False),
    "open_fridge": _fridge(open_fridge, out=True),
    "close_fridge": _fridge(close_fridge, out=False),
}
"""Skill -> provider, with ground truth."""

ANY = StandingConfig(enough_score=1)
"""The first base pose with a solution."""

FRICTION_SKILLS = {
    "pick": replace(
        PICK,
        motion=pick_by_friction,
        standing=StandingConfig(enough_score=4),
        score=lambda robot, number, _map: partial(friction_pick_score, robot, number),
    ),
    "place": PLACE,
    "open_drawer": _drawer(open_drawer_by_friction, friction_drawer_score, True, ANY),
    "close_drawer": _drawer(
        close_drawer_by_friction, friction_drawer_score, False, ANY, CLOSE_DRAWER
    ),
    "open_fridge": _fridge(open_fridge_by_friction, out=True, config=OPEN),
    "close_fridge": _fridge(push_fridge_closed, out=False, config=CLOSE_ON),
}
"""Likewise, with fingers that grasp by friction."""
