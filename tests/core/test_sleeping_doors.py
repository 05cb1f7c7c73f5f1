"""Frozen objects near moving furniture, at the apartment's counter."""

import numpy as np
import pytest
import sapien
from builders import box_actor, cpu_scene, start_fetch

from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.sleeping import SleepingObjects
from hab_tasks.scenes.habitat.dataset import resolve_dataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.markers import HANDLE_MARKERS
from hab_tasks.scenes.pool import BodyPool

NOBODY = -1
MARKER = next(m for m in HANDLE_MARKERS if m.name == "cab_push_point_5")
SMALL = (0.02, 0.02, 0.02)


class Counter:
    """The counter's drawer, a box in it, one 0.45 m in front of its handle and one far away."""

    def __init__(self):
        dataset = resolve_dataset("apartment")
        spec = load_scene(dataset, sorted(dataset.scene_files)[0])
        self.scene = cpu_scene()
        self.agent = HabFetch(self.scene, 30, "joint_target")
        self.boxes = [box_actor(self.scene, f"box{i}", SMALL, (0, 0, 9 + i)) for i in range(3)]
        built = BodyPool(self.scene, {}).show(spec, ())
        self.scene._setup(enable_gpu=False)
        start_fetch(self.agent)
        self.counter = built.articulations[MARKER.template + "_:0000"]
        self.link = self.counter.links_map[MARKER.link]
        joints = [joint.name for joint in self.counter.active_joints]
        self.column = joints.index(self.link.joint.name)
        furniture, links = list(built.articulations.values()), dict(self.agent.robot.links_map)
        self.sleeping = SleepingObjects(self.boxes, links, furniture, mobile=False)
        self.sleeping.thaw_all()
        self.put_boxes()
        self.sleeping.freeze_all(np.ones(3, dtype=bool))

    def handle_m(self):
        return (self.link.pose.sp * sapien.Pose(list(MARKER.offset_m))).p

    def put_boxes(self):
        inside = np.mean(self.link._objs[0].compute_global_aabb_tight(), axis=0)
        handle_m = self.handle_m()
        self.open(0.05)
        ahead = (self.handle_m() - handle_m) / np.linalg.norm(self.handle_m() - handle_m)
        self.open(0.0)
        for box, point in zip(self.boxes, (inside, handle_m + 0.45 * ahead), strict=False):
            box.set_pose(sapien.Pose(point))
            box._bodies[0].disable_gravity = True

    def open(self, position_m):
        qpos = self.counter.get_qpos()
        qpos[0, self.column] = position_m
        self.counter.set_qpos(qpos)

    def frozen(self):
        return [box._bodies[0].kinematic for box in self.boxes]


def test_a_drawer_on_the_move_wakes_what_is_in_it_and_before_it_and_at_rest_nobody():
    counter = Counter()
    for touching in (*(True, False) * 15, True):
        counter.sleeping.before_step(NOBODY, touching)
    assert counter.frozen() == [True, True, True]
    counter.open(0.002)
    counter.sleeping.before_step(NOBODY, True)
    assert counter.frozen() == [False, True, True]
    # It wakes the box 0.45 m ahead of its handle 0.1 m before it, also when the hand has left the
    # drawer, which slides on, and nothing is in it.
    counter.sleeping.freeze_all(np.array([False, True, True]))
    position, touching = 0.0, True
    while counter.frozen()[1]:
        position += 0.01
        counter.open(position)
        counter.sleeping.before_step(NOBODY, touching)
        touching = False
    assert position == pytest.approx(0.45 - 0.02 - 0.1, abs=0.06)
    assert counter.frozen() == [True, False, True]
