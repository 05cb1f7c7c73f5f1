"""Checks of start states in a sandbox other than the one that generated them."""

import functools
import math

import numpy as np
import torch

from hab_tasks.articulations import HANDLE_MARKERS
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import template_of
from hab_tasks.episodes.source import EpisodeSource
from hab_tasks.geometry import to_matrix
from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.kinematics import ArmKinematics

AABB = "receptacle_aabb_"
SOFA = AABB + "Sofa_frl_apartment_sofa"
FRIDGE = AABB + "middle_topfrl_apartment_refrigerator"
COUNTERS = {AABB + "counter_left_kitchen_counter", AABB + "counter_right_kitchen_counter"}
SINK = AABB + "sink_kitchen_counter"
TABLE_LIGHT = AABB + "Tbl1_Top1_frl_apartment_table_01"
TABLE_DARK = AABB + "Tbl2_Top1_frl_apartment_table_02"
CHAIR = AABB + "Chr1_Top1_frl_apartment_chair_01"
TV_STAND = AABB + "TvStnd1_Top1_frl_apartment_tvstand"
DRAWER = AABB + "drawer_right_top_frl_apartment_kitchen_counter"
SHELVES = {f"{AABB}WC2_Top{i}_frl_apartment_wall_cabinet_02" for i in range(1, 7)}

SIX = {SOFA, FRIDGE, *COUNTERS, TABLE_LIGHT, TABLE_DARK}
EIGHT = {CHAIR, TABLE_LIGHT, TABLE_DARK, TV_STAND, SINK, *COUNTERS, SOFA}
"""The receptacles of Pick (S H.2), and Habitat's open ones."""

SEEN = {"002_master_chef_can", "003_cracker_box", "004_sugar_box", "005_tomato_soup_can"}
SEEN |= {"007_tuna_fish_can", "008_pudding_box", "009_gelatin_box", "010_potted_meat_can"}
SEEN |= {"024_bowl"}
UNSEEN = {"013_apple", "017_orange", "025_mug", "026_sponge"}
"""Objects of S E.1."""

SKILLS = ("HabPick-v1", "HabPlace-v1", "HabOpenFridge-v1", "HabCloseFridge-v1")
SKILLS += ("HabOpenDrawer-v1", "HabCloseDrawer-v1", "HabNavigate-v1")
TASKS = ("HabTidyHouse-v1", "HabPrepareGroceries-v1", "HabSetTable-v1")

BASE_NOISE_M = math.hypot(0.1, 0.1)
CELL_M = 0.05


@functools.lru_cache(maxsize=4)
def load_sandbox(source: EpisodeSource, scene_id: str) -> PlacementSandbox:
    return PlacementSandbox(source.scene(scene_id), source.objects)


class Replay:
    """An episode's start state in a new sandbox."""

    def __init__(self, source: EpisodeSource, episode):
        self.episode, self.templates = episode, source.objects
        self.sandbox = load_sandbox(source, episode.scene_id)
        self.stand()

    def stand(self, poses=None):
        """Shows objects (handle -> pose; those of the start if None), loose ones and furniture."""
        poses = self.episode.objects if poses is None else poses
        self.sandbox.show(poses)
        for furniture, joints in self.episode.joints.items():
            for joint, value in joints.items():
                self.sandbox.set_joint(furniture, joint, value)
        for name, pose in {**self.episode.loose, **poses}.items():
            self.sandbox.place(name, pose)

    def resting(self):
        """What must stay where it is: everything but what is held."""
        return {k: v for k, v in self.episode.objects.items() if k != self.episode.held}

    def at_goals(self):
        """Start poses with every target at its goal instead."""
        goals = {t.object: t.world_from_goal for t in self.episode.targets if t.world_from_goal}
        return {**self.episode.objects, **goals}

    def moved_m(self, poses, watched=None):
        """How far the farthest of `watched` objects (default all) gets in 2 s of physics."""
        self.stand(poses)
        self.sandbox.settle(2.0, tuple(poses))
        names = poses if watched is None else watched
        return max((math.dist(self.sandbox.pose(n)[:3], poses[n][:3]) for n in names), default=0.0)

    def joints_moved(self):
        """How far the farthest joint of the episode's furniture gets in 2 s [m or rad]."""
        self.stand(self.resting())
        self.sandbox.settle(2.0, tuple(self.resting()))
        after = self.sandbox.joints()
        ways = [0.0]
        for furniture, joints in self.episode.joints.items():
            now = after.get(furniture, {})
            ways += [abs(now.get(j, 0.0) - joints.get(j, 0.0)) for j in {*now, *joints}]
        return max(ways)

    def overlaps(self, poses):
        """Pairs of names -> how deep [m] an object is in something else, more than 2 mm."""
        self.stand(poses)
        names = {body: name for name, (_, body) in self.sandbox._components.items()}
        found = {}
        self.sandbox._px.step()
        for contact in self.sandbox._px.get_contacts():
            pair = tuple(sorted(names.get(body, "robot") for body in contact.bodies))
            depth_m = max((-point.separation for point in contact.points), default=0.0)
            if depth_m > 0.002 and set(pair) & set(poses):
                found[pair] = depth_m
        return found

    def box_of(self, ref):
        """The (4, 4) pose of a receptacle's box and the receptacle."""
        (receptacle,) = [r for r in self.sandbox.spec.receptacles if (r.name, r.body) == ref]
        return self.sandbox.world_from(receptacle.body) @ to_matrix(
            receptacle.body_from_box
        ), receptacle

    def over(self, point_m, ref):
        """Where a point is: how far [m] beside a receptacle's box, and above its lower face."""
        world_from_box, receptacle = self.box_of(ref)
        local = np.linalg.inv(world_from_box) @ np.append(point_m, 1.0)
        up, half = np.array(receptacle.up), np.array(receptacle.half_size_m)
        beside = (np.abs(local[:3]) - half)[np.abs(up) < 0.5].max()
        return float(beside), float(up @ local[:3] + np.abs(up) @ half)

    def stands_on(self, name, ref):
        """Whether a shown object lies on a receptacle: over it, and down on its face."""
        beside, _ = self.over(self.sandbox.com_m(name), ref)
        low, _ = self.sandbox._components[name][1].compute_global_aabb_tight()
        world_from_box, receptacle = self.box_of(ref)
        up, half = np.array(receptacle.up), np.array(receptacle.half_size_m)
        face_m = (world_from_box @ np.append(-up * (np.abs(up) @ half), 1.0))[2]
        # Cushions give way by 3 cm, and the box may hover a little above the board.
        return beside < 0.02 and -0.035 < low[2] - face_m < 0.02

    def count_on(self, name):
        """Receptacles of a name -> how many objects have their middle over its face."""
        refs = [(r.name, r.body) for r in self.sandbox.spec.receptacles if r.name == name]
        return {ref: sum(self.stands_on(o, ref) for o in self.resting()) for ref in refs}

    # The robot -----------------------------------------------------------------------------------

    def touches(self):
        """What the robot touches where it starts, but for what it holds; itself by a millimetre."""
        self.stand(self.resting())
        agent, sandbox = self.sandbox._agent, self.sandbox
        qpos = agent.rest_qpos()
        qpos[agent.base_index] = torch.tensor(self.episode.robot.base)
        qpos[agent.arm_index] = torch.tensor(self.episode.robot.arm_pose(FETCH)).float()
        agent.robot.set_qpos(qpos[None])
        agent.robot.set_qvel(torch.zeros_like(qpos)[None])
        sandbox._px.step()
        names = {body: name for name, (_, body) in sandbox._components.items()}
        links = {link._objs[0]: link.name for link in agent.robot.links}
        found = set()
        for contact in sandbox._px.get_contacts():
            bodies = contact.bodies
            depth_m = max((-point.separation for point in contact.points), default=-1.0)
            limit_m = 0.001 if set(bodies) <= links.keys() else 0.0
            if set(bodies) & links.keys() and depth_m > limit_m:
                found.add(tuple(links.get(b) or names[b] for b in bodies))
        sandbox.send_robot_away()
        return found

    def off_floor_m(self, base):
        """Distance from a base position to the nearest place with 0.32 m of clearance."""
        cells = self.sandbox.floor().cells_by_distance(np.array(base[:2]), 0.32, 0.0)
        return float(np.linalg.norm(cells[0] - base[:2]))

    def heading_off_rad(self, base, point_m):
        """How far a base is turned away from a point."""
        way = np.subtract(point_m[:2], base[:2])
        return abs(math.remainder(math.atan2(way[1], way[0]) - base[2], math.tau))

    def ee_m(self):
        """The end-effector (3,) in the world; the base's frame is 5 mm above the floor."""
        x, y, yaw = self.episode.robot.base
        ahead, side, up = ArmKinematics(FETCH).position(self.episode.robot.arm_pose(FETCH))
        c, s = math.cos(yaw), math.sin(yaw)
        return np.array([x + c * ahead - s * side, y + s * ahead + c * side, up + 0.005])

    # Furniture -----------------------------------------------------------------------------------

    def marker_m(self):
        """The handle (3,) of the episode's door or drawer, as it stands."""
        furniture = self.episode.handle.furniture
        marker = next(
            m
            for m in HANDLE_MARKERS
            if (m.name, m.template) == (self.episode.handle.marker, template_of(furniture))
        )
        (scale,) = [a.scale for a in self.sandbox.spec.articulations if a.name == furniture]
        world_from_link = self.sandbox.world_from(f"{furniture}/{marker.link}")
        return (world_from_link @ np.append(scale * np.array(marker.offset_m), 1.0))[:3]

    def in_frame(self, base, body):
        """A base position (x ahead, y to the left) in the upright frame of a link."""
        world_from_link = self.sandbox.world_from(body)
        ahead = world_from_link[:2, 0] / np.linalg.norm(world_from_link[:2, 0])
        way = np.subtract(base[:2], world_from_link[:2, 3])
        return float(ahead @ way), float(ahead[0] * way[1] - ahead[1] * way[0])
