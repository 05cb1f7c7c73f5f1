"""Start states of Place (S H.2): a goal and clutter on a receptacle, the object in the grasp."""

from __future__ import annotations

import math

import numpy as np
from transforms3d import quaternions

from hab_tasks.episodes.generators.base import (
    Generator,
    open_joints,
    put_all,
    stage,
    start_state,
)
from hab_tasks.episodes.generators.pick import CLUTTER
from hab_tasks.episodes.placing import Placer
from hab_tasks.episodes.receptacles import PLACE_RECEPTACLES
from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.rehearsal import falls_to
from hab_tasks.episodes.robot_start import KeepOff, ee_in_world
from hab_tasks.episodes.schema import Episode, Rearrangement, RobotStart, rounded, template_of
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Array, Pose7, pose, rotation_between


class Place(Generator):
    """A free goal among clutter on one of the seven receptacles."""

    def attempt(self, bench: Workbench, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        spots = self.spots(bench, self.objects.receptacles or PLACE_RECEPTACLES)
        spot = spots[int(rng.integers(len(spots)))]
        handles = self.draw(rng, 1 + int(rng.integers(CLUTTER[0], CLUTTER[1] + 1)))
        held = handles[0]
        bench.show(handles)
        open_joints(bench, spot.joints)
        placer = Placer(bench, rng, self.settling)
        if not placer.put(held, [spot]):
            raise RefusedError("no room on the receptacle")
        put_all(placer, handles[1:], [spot])
        objects = placer.settle()
        if held not in objects:
            raise RefusedError("the object does not stay at its goal")
        goal = objects.pop(held)
        goal_com_m, com_m = bench.com_m(held), bench.com_in_object_m(held)
        stage(bench, objects, spot.joints)
        # Let go, the object must not fall onto its goal.
        keep_off = KeepOff(points_m=goal_com_m[None], level=True)
        robot = self.starts(bench, rng, keep_off).facing(goal_com_m)
        yaw = rng.uniform(-math.pi, math.pi)
        up = np.array(bench.templates[template_of(held)].up)
        objects[held] = self.in_hand(com_m, up, robot, yaw)
        stage(bench, objects, spot.joints)
        if bench.touching(held):
            raise RefusedError("the held object touches something")
        if falls_to(bench, robot, held, goal_com_m):
            raise RefusedError("let go, the object gets to its goal by itself")
        stage(bench, objects, spot.joints)
        target = Rearrangement(object=held, goal=spot.ref, world_from_goal=goal)
        return start_state(bench, robot, objects, (target,), held=held)

    def in_hand(self, com_m: Array, up: Array, robot: RobotStart, yaw_rad: float) -> Pose7:
        """Returns the upright pose that has an object's centre of mass at the end-effector.

        Args:
            com_m: The centre of mass (3,) in the object's frame.
            up: The object's upright axis (3,).
            robot: Where the robot starts.
            yaw_rad: How the object is turned.
        """
        turn = quaternions.axangle2quat([0.0, 0.0, 1.0], yaw_rad)
        q = quaternions.qmult(turn, rotation_between(up, np.array([0.0, 0.0, 1.0])))
        ee_m = ee_in_world(self.kinematics, robot.base, np.array(robot.arm_qpos_rad))
        return rounded(pose(ee_m - quaternions.rotate_vector(com_m, q), q))
