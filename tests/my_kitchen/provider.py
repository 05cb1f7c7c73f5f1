"""The cabinet's door by sense-plan-act: the drawer's motion, from in front of the cabinet."""

from functools import partial

import numpy as np
from hab_spa.skills.drawer import DrawerConfig, drawer_score, open_drawer
from hab_spa.tasks.planned_skills import PlannedSkill

CONFIG = DrawerConfig(open_share=0.6, rounds=1)


def base_poses(robot, number, map_):
    """Free base poses (K, 3) that face the cabinet."""
    door = robot.scene.articulation(number)
    yaw = door.frame[2] - np.pi / 2  # the frame's x axis is along the doors
    axes = np.array(((np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))))
    steps_m = [(far, aside) for far in (0.6, 0.7, 0.5, 0.8) for aside in (0.2, 0.0, -0.2, 0.4)]
    places = door.handle_m[:2] + np.array(steps_m) @ axes
    return np.array([(*place, yaw + np.pi) for place in places if map_.is_free(place)])


def score(robot, number, map_):
    """The motion is found or not."""
    return lambda base, effort: drawer_score(robot, number, base, True, CONFIG)


def open_cabinet(setup):
    """Returns the provider of ``open_cabinet``."""
    motion = partial(open_drawer, config=CONFIG)
    return PlannedSkill(motion=motion, base_poses=base_poses, score=score)
