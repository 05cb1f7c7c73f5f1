"""What an executor of plans needs: a robot, skill providers, a navigator and a hand-over.

Providers, navigators and hand-overs are made for one episode of one robot, or keep no state. A
motion planner is what the skills of a planning robot need.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from hab_plans.belief import Scene
from hab_plans.motion import Failure, Motion
from hab_plans.stage import Stage
from hab_tasks.privileged import Array

R = TypeVar("R", contravariant=True)
"""Class of the robot."""

T = TypeVar("T")
W = TypeVar("W", contravariant=True)
C = TypeVar("C", contravariant=True)


class Robot(Protocol):
    """The robot of one row.

    Attributes:
        steps: Number of commands executed in this episode.
        deadline: Step by which the current motion should end.
        doing: Current activity, as text.
        failure: The latest failure.
        trace: Log of beliefs and motions, one entry per motion.
    """

    steps: int
    deadline: int
    doing: str
    failure: Failure | None
    trace: list[dict[str, Any]]

    @property
    def scene(self) -> Scene:
        """What the robot believes of the world; only part of it without ground truth."""
        ...

    @property
    def settle_steps(self) -> int:
        """Steps beyond the deadline in which a motion may still come to rest."""
        ...

    def relax(self) -> None:
        """Sets the arm's targets to its current pose."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class BasePose:
    """A base pose (3,), x, y [m] and yaw [rad], and how the robot drives there.

    Attributes:
        base: The pose.
        arm_rad: (J,) arm pose while it drives.
        turning_m: Clearance in which the base turns, for an arm that sticks out; else 0.
    """

    base: Array
    arm_rad: Array
    turning_m: float = 0.0


class SkillProvider(Protocol[R]):
    """A skill inside tasks: planned, a trained policy, or any agent.

    Attributes:
        name: Who executes the skill, for the trace.
        horizon_steps: Maximum number of steps.
        knows_effect: Whether the robot notices that the effect does not hold, though the skill has
            ended by its own condition.
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def horizon_steps(self) -> int: ...  # noqa: D102

    @property
    def knows_effect(self) -> bool: ...  # noqa: D102

    def can_start(self, robot: R, stage: Stage) -> bool:
        """Whether to navigate for a stage; if not, the skill starts, and fails, where it is."""
        ...

    def base_pose(self, robot: R, stage: Stage, tried: Sequence[BasePose]) -> BasePose | None:
        """Returns the base pose to start from next; None if there is no other than those tried."""
        ...

    def start_of(self, robot: R, stage: Stage) -> str | None:
        """Returns what is to be noted of a start, e.g. ``new`` for one that training lacks."""
        ...

    def start(self, robot: R, stage: Stage) -> Motion:
        """Returns the motion of the skill: each command is an act, and its return tells the end."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class NavigationRequest:
    """A navigation goal.

    Attributes:
        stage: Stage before which the robot navigates.
        tried: Base poses chosen so far, the latest last.
        choose_base_pose: Chooses another base pose; None if there is none. It may use more
            knowledge than the robot has, so learned navigators must not call it.
    """

    stage: Stage
    tried: Sequence[BasePose]
    choose_base_pose: Callable[[], BasePose | None]


class Navigator(Protocol[R]):
    """Moves the base.

    Attributes:
        horizon_steps: Maximum number of steps of a way.
    """

    @property
    def horizon_steps(self) -> int: ...  # noqa: D102

    def go(self, robot: R, request: NavigationRequest) -> Motion:
        """Returns the motion; `Failure.TARGET_PLAN` if there is no base pose to go to."""
        ...


class HandOver(Protocol):
    """What happens to the arm between skills."""

    def prepare(self, stage: Stage, attempt: int) -> Motion:
        """Returns the motion before navigation: the arm comes to rest."""
        ...

    def arrive(self, stage: Stage, request: NavigationRequest) -> Motion:
        """Returns the motion after navigation, before the skill."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Team(Generic[T]):
    """Who executes a plan.

    Attributes:
        skills: Skill -> provider.
        navigator: Moves the base.
        hand_over: Moves the arm between skills.
    """

    skills: Mapping[str, SkillProvider[T]]
    navigator: Navigator[T]
    hand_over: HandOver


@dataclass(frozen=True, kw_only=True, eq=False)
class PathResult:
    """A path of the arm.

    Attributes:
        path: (K, J) [rad], piecewise linear in joint space; None if none was found.
        failure: `Failure.MOTION_PLAN` if none was found.
        seconds: Computing time [s].
        checks: Number of collision checks.
        simplify_s: Share of the computing time for shortening the path [s].
        stopped_by: Limit that ended a search without a path: ``checks`` or ``time``.
    """

    path: Array | None
    failure: Failure | None
    seconds: float
    checks: int
    simplify_s: float = 0.0
    stopped_by: str | None = None


class MotionPlanner(Protocol[W, C]):
    """Plans paths of the arm in a world `W`, within limits `C`."""

    def plan(
        self,
        start: Array,
        goals: Array,
        world: W,
        *,
        seed: int,
        limits: C,
        touch_m: float = 0.001,
        backwards: bool = False,
    ) -> PathResult:
        """Plans a collision-free path from an arm pose (J,) to one of the goals (G, J).

        Args:
            start: The arm pose [rad].
            goals: The goals [rad], best first, at least one.
            world: Collision model; its clearance may be changed.
            seed: Random seed.
            limits: Time and effort.
            touch_m: Tolerance for shapes that are in contact at an end.
            backwards: Whether the start, rather than the goal, is the end near obstacles.
        """
        ...
