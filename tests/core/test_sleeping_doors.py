"""Frozen objects near moving furniture, at the apartment's counter."""

import itertools

import numpy as np
import pytest
import sapien
from builders import box_actor, cpu_scene, start_fetch

from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.sleeping import SleepingObjects
from hab_tasks.scenes import collision_groups as groups
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
        name = next(n for n in built.articulations if n.startswith(MARKER.template + "_:"))
        self.counter = built.articulations[name]
        self.link = self.counter.links_map[MARKER.link]
        joints = [joint.name for joint in self.counter.active_joints]
        self.column = joints.index(self.link.joint.name)
        self.put_boxes()
        furniture = list(built.articulations.values())
        links = dict(self.agent.robot.links_map)
        self.sleeping = SleepingObjects(self.boxes, links, furniture, mobile=False)
        self.sleeping.thaw_all()
        self.sleeping.freeze_all(np.ones(3, dtype=bool))

    def put_boxes(self):
        pose = self.link.pose.sp
        low, high = self.link._objs[0].compute_global_aabb_tight()
        inside = np.add(low, high) / 2
        handle = (pose * sapien.Pose(list(MARKER.offset_m))).p
        self.open(0.05)
        ahead = (self.link.pose.sp * sapien.Pose(list(MARKER.offset_m))).p - handle
        self.open(0.0)
        self.ahead = ahead / np.linalg.norm(ahead)
        for box, point in zip(self.boxes, (inside, handle + 0.45 * self.ahead), strict=False):
            box.set_pose(sapien.Pose(point))
            box._bodies[0].disable_gravity = True

    def open(self, position_m):
        qpos = self.counter.get_qpos()
        qpos[0, self.column] = position_m
        self.counter.set_qpos(qpos)

    def frozen(self):
        return [box._bodies[0].kinematic for box in self.boxes]


@pytest.fixture
def counter():
    return Counter()


def test_a_drawer_on_the_move_wakes_what_is_in_it_and_before_it_and_at_rest_nobody(counter):
    for touching in (*(True, False) * 15, True):
        counter.sleeping.before_step(NOBODY, touching)
    assert counter.frozen() == [True, True, True]
    counter.open(0.002)
    counter.sleeping.before_step(NOBODY, True)
    assert counter.frozen() == [False, True, True]
    # A drawer of 0.45 m in front of the handle less the box's half and 0.1 m: it wakes in time.
    limit = float(counter.counter.get_qlimits()[0, counter.column, 1])
    woke_at = None
    for position in np.arange(0.0, limit, 0.01):
        counter.open(float(position))
        counter.sleeping.before_step(NOBODY, True)
        if woke_at is None and not counter.frozen()[1]:
            woke_at = float(position)
    assert woke_at is not None
    assert woke_at == pytest.approx(0.45 - 0.02 - 0.1, abs=0.06)
    assert counter.frozen()[2]


def test_a_drawer_that_slides_on_is_watched_after_the_hand_has_left_it(counter):
    counter.sleeping.freeze_all(np.array([False, True, True]))  # nothing in the drawer
    counter.sleeping.before_step(NOBODY, False)
    counter.open(0.01)
    counter.sleeping.before_step(NOBODY, True)
    limit = float(counter.counter.get_qlimits()[0, counter.column, 1])
    for position in np.arange(0.02, limit, 0.01):
        counter.open(float(position))
        counter.sleeping.before_step(NOBODY, False)
    assert counter.frozen() == [True, False, True]


MEET = {
    "ROBOT": "STATIC MOVING FRONT PASSIVE FROZEN",
    "STATIC": "MOVING HELD FRONT",
    "MOVING": "HELD FRONT PASSIVE FROZEN",
    "HELD": "FRONT PASSIVE FROZEN",
    "FRONT": "PASSIVE",
}
"""Not the robot and what it holds, not doors and frozen objects, not what is at rest."""


def test_who_meets_whom():
    names = ("ROBOT", "STATIC", "MOVING", "HELD", "FRONT", "PASSIVE", "FROZEN")
    meet = set()
    for a, b in itertools.combinations(names, 2):
        first, second = getattr(groups, a), getattr(groups, b)
        if first[0] & second[1] or first[1] & second[0]:
            meet.add((a, b))
    assert meet == {(a, b) for a, others in MEET.items() for b in others.split()}
