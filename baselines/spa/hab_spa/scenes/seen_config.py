"""Parameters of SPA's perception."""

from __future__ import annotations

from dataclasses import dataclass, field

from hab_spa.planning.joint_goal import GraspConfig
from hab_spa.sensing.fitted_box import BoxConfig
from hab_spa.sensing.seen_map import MapConfig


@dataclass(frozen=True, kw_only=True)
class SeenConfig:
    """Parameters of SPA's perception.

    Attributes:
        own_margin_m: Points within this distance of the robot are its own.
        touch_margin_m: Voxels within this distance of the robot or the held object are free.
        held_margin_m: Points within this distance of the held object's box belong to it.
        unseen_m: As `held_margin_m`, for an object that was grasped without being seen.
        reach_m: Maximum distance of obstacles from the shoulder.
        map_m: Maximum distance of mapped points from the shoulder.
        watch_steps: Interval of checks for new obstacles during a motion.
        cell_m: Edge of the grid cells; each is an obstacle of its own.
        fit_reach_m: Radius of the points around the object for fitting its box.
        fit_spacing_m: Spacing of these points ...
        fit_slope: ... and their slope; see `hab_spa.sensing.cloud.surface_points_m`.
        runner_up_m: Minimum additional distance of other objects from a grasping hand.
        front_m: Radius around the handle within which a left-out door or drawer is removed.
        map, box, grasp: Parameters of the stages.
    """

    own_margin_m: float = 0.03
    touch_margin_m: float = 0.003
    held_margin_m: float = 0.04
    unseen_m: float = 0.06
    reach_m: float = 1.6
    map_m: float = 1.9
    watch_steps: int = 6
    cell_m: float = 0.4
    fit_reach_m: float = 0.45
    fit_spacing_m: float = 0.008
    fit_slope: float = 3.0
    runner_up_m: float = 0.02
    front_m: float = 0.25
    map: MapConfig = field(default_factory=MapConfig)
    box: BoxConfig = field(default_factory=BoxConfig)
    grasp: GraspConfig = field(default_factory=GraspConfig)
