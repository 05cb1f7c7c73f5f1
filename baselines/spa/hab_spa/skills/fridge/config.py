"""Parameters of opening and closing the fridge, the pull for a door, and how far it has to open."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hab_spa.motion.robot import Robot
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.skills.fridge.arc import Pull
from hab_spa.skills.fridge.base_poses import BasePoseConfig
from hab_spa.skills.fridge.door import Door
from hab_spa.skills.fridge.maneuver import ManeuverConfig
from hab_tasks.privileged import ArticulationState

NEAR_M = 0.115
"""The hand grasps within 0.15 m, of which an error of the handle's position takes its share."""


@dataclass(frozen=True, kw_only=True)
class FridgeConfig:
    """Parameters of opening and closing the fridge.

    Attributes:
        open_to, opened: Target opening of the hand's motion, and opening at which the door is
            fully open [rad]: just beyond the success threshold, so that the door can be closed
            again and hits no wall.
        let_go: Opening at which the hand releases the door; friction stops it [rad].
        open_need: Minimum opening of an acceptable pull of a closed door, ...
        open_more: ... or minimum increase for a door that is partly open [rad].
        close_to, closed: Target opening of the hand's motion, and opening at which the door is
            fully closed [rad].
        close_need: Minimum decrease of the opening of an acceptable pull [rad].
        go_on, go_on_steps: The arm continues from its current pose if that moves the door by at
            least this angle [rad] at a cost of fewer than these steps.
        grasp_steps: Maximum steps until a grasp holds.
        takes: Maximum number of grasps ...
        plan_tries: ... and of those for which no path is found.
        drives: Maximum number of drives to a base pose, if something new is in the way.
        grasps_m: Grasp points, as (along, out) offsets from the handle, ...
        around_m: ... and at the door's edge, in front of, beside and behind it, since the snap
            grasp reaches through the door; from there the hand follows the door's whole arc.
        candidates: Maximum number of candidate pulls for the motion planner ...
        as_good_steps: ... and their maximum cost above the best.
        reach_share: Share of the remaining time for reaching the handle, within speed limits.
        pace: Pace of the motion along the arc.
        rest_paces: Paces of the motion to rest, the last where time is short, ...
        rest_plans: ... maximum number of plans of it, as an arm near the door drags it along, ...
        back_rad: ... which may move the door back by at most this angle.
        brake_steps: A door that the hand cannot close completely is released this many steps
            before the end of the motion, so that it swings on.
        hold_steps: Any other door is held until it is slow, for at most these steps.
        slow_rad: Speed below which friction soon stops a door [rad/step].
        release_steps: Steps to wait after a release.
        at_handle_rad: Joint tolerance at the end of the reach.
        patience_steps: Steps without motion after which a door has stopped.
        still_rad: Speed below which a door does not move [rad/step].
        wait_steps: Maximum steps to wait for a swinging door.
        spare_steps: Time reserve when checking whether a pull fits the remaining time.
        as_is_tries: Base poses evaluated with the arm as it is after a pull, before it rests.
        slack_rad: A door counts as closed so far below the threshold, if it is only seen.
        near_first: Whether grasp points near the handle are preferred, if it is only seen.
        plan: Parameters of the motion planner; more computing, as short paths matter, and larger
            margins, as a touched door moves.
        base_poses: Number of candidate base poses for navigation.
        quick_steps: Costs of a pull with the best and with the worst score.
        base_pose: Parameters of base pose selection.
        maneuver: Parameters of base maneuvers.
    """

    open_to: float = 1.8
    opened: float = 1.62
    let_go: float = 1.7
    open_need: float = 0.7
    open_more: float = 0.25
    close_to: float = 0.03
    closed: float = 0.1
    close_need: float = 0.45
    go_on: float = 0.2
    go_on_steps: float = 120.0
    grasp_steps: int = 8
    takes: int = 6
    plan_tries: int = 6
    drives: int = 3
    grasps_m: tuple[tuple[float, float], ...] = (
        (0.0, 0.02), (0.0, 0.06), (0.04, 0.06), (0.08, 0.03), (0.1, 0.05), (0.0, 0.1)
    )  # fmt: skip
    around_m: tuple[tuple[float, float], ...] = (
        (0.11, 0.0), (0.12, -0.05), (0.1, -0.09), (0.06, -0.12), (0.0, -0.13)
    )  # fmt: skip
    candidates: int = 6
    as_good_steps: float = 25.0
    reach_share: float = 0.08
    pace: float = 1.6
    rest_paces: tuple[float, ...] = (1.6, 2.4)
    rest_plans: int = 4
    back_rad: float = 0.04
    brake_steps: int = 5
    hold_steps: int = 12
    slow_rad: float = 0.005
    release_steps: int = 1
    at_handle_rad: float = 0.05
    patience_steps: int = 4
    still_rad: float = 0.002
    wait_steps: int = 60
    spare_steps: float = 25.0
    as_is_tries: int = 8
    slack_rad: float = 0.0
    near_first: bool = False
    plan: PlanConfig = field(
        default_factory=lambda: PlanConfig(
            margins_m=(0.04, 0.02, 0.01, 0.003), good_rad=0.8, improve_checks=24_000
        )
    )
    base_poses: int = 64
    quick_steps: tuple[float, float] = (80.0, 200.0)
    base_pose: BasePoseConfig = field(default_factory=BasePoseConfig)
    maneuver: ManeuverConfig = field(default_factory=ManeuverConfig)

    def nearer(self) -> FridgeConfig:
        """Returns the parameters with only those grasp points that are near the handle."""
        points_m = (*self.grasps_m, *self.around_m)
        near = tuple(point for point in points_m if np.hypot(*point) < NEAR_M)
        return replace(self, grasps_m=near, around_m=())


def pull_of(articulation: ArticulationState, out: bool, config: FridgeConfig) -> Pull:
    """Returns the pull for a door in its current state."""
    door = Door(articulation)
    handle = door.handle_m
    offsets = (*config.grasps_m, *config.around_m)
    if out:
        end, complete = config.open_to, config.opened
        need = min(complete, max(config.open_need, door.joint + config.open_more))
    else:
        end, complete = config.close_to, config.closed
        need = max(complete, door.joint - config.close_need)
    return Pull(
        end=end,
        need=need,
        complete=complete,
        swept=(min(door.joint, end), max(door.joint, end)),
        grasps_m=tuple((handle[0] + a, handle[1] + o) for a, o in offsets),
        opening=out,
    )


@dataclass(frozen=True, kw_only=True)
class ExitConfig:
    """Parameters of the search.

    Attributes:
        enclosed_m: A base farther than this from the room's free floor is enclosed.
        front_m: What is in the fridge is taken from so far in front of its middle, ...
        beside_m: ... or from free floor that is at most so far from there.
        spacing_rad: Spacing of the joint positions searched.
        beyond_rad: Additional opening beyond the first joint position that frees the robot.
    """

    enclosed_m: float = 0.5
    front_m: float = 1.0
    beside_m: float = 0.3
    spacing_rad: float = 0.1
    beyond_rad: float = 0.1


def wider(
    robot: Robot, number: int, config: FridgeConfig, exit_: ExitConfig
) -> FridgeConfig | None:
    """Returns the parameters for opening the door farther, so that the robot can go on.

    Returns:
        None if the door is in the robot's way neither from here nor to the fridge's front, or if
        no joint position clears it.
    """
    if not _is_enclosed(robot, number, None, exit_):
        return None
    articulation = robot.scene.articulation(number)
    most = articulation.limits[1] - exit_.beyond_rad
    for joint in np.arange(
        articulation.joint + exit_.spacing_rad, most, exit_.spacing_rad
    ).tolist():
        if not _is_enclosed(robot, number, joint, exit_):
            opened = joint + exit_.beyond_rad / 2
            return replace(config, opened=opened, let_go=opened, open_to=joint + exit_.beyond_rad)
    return None


def _is_enclosed(robot: Robot, number: int, joint: float | None, config: ExitConfig) -> bool:
    """Whether the base or the fridge's front is cut off from the room by the door at a joint."""
    map_ = robot.scene.floor_map(None if joint is None else {number: joint})
    x, y, yaw = robot.scene.articulation(number).frame
    front_m = np.array((x + config.front_m * np.cos(yaw), y + config.front_m * np.sin(yaw)))
    return any(
        np.linalg.norm(map_.nearest_free(point_m) - point_m) > most_m
        for point_m, most_m in ((robot.base[:2], config.enclosed_m), (front_m, config.beside_m))
    )
