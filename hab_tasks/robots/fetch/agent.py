"""`hab_fetch`: ManiSkill's Fetch with the paper's control, cameras and rest pose."""

from __future__ import annotations

from functools import cache
from xml.etree import ElementTree

from mani_skill.agents.registration import register_agent

from hab_tasks.robots.fetch import FETCH, FETCH_FRICTION
from hab_tasks.robots.fetch.light_visuals import lighten
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.scenes.fixed_links import merge_fixed_links
from hab_tasks.world.scenes.urdf import remove_visuals

NEAR_PAIRS = (("head_pan_link", "shoulder_lift_link"), ("head_tilt_link", "shoulder_lift_link"))
"""Link pairs within 2 cm of each other in the resting pose that never touch (minimum distance
1.9 cm); the engine would check them for contacts in every step."""


@cache
def _fetch_urdf(fetch: RobotSpec, visuals: bool) -> str:
    """Returns the URDF of a Fetch, with light visuals or without visuals.

    Wheels have no collision shapes: they are inside the base's outline and touch only the floor.
    Wheels, laser and other parts on fixed joints are merged into the link that carries them: the
    engine would simulate 12 more links in every step.
    """
    source = fetch.urdf_path()
    root = ElementTree.parse(source).getroot()
    if visuals:
        lighten(root, source.parent)
    else:
        remove_visuals(root)
    for link in root.iter("link"):
        if "wheel" in link.get("name", ""):
            for collision in link.findall("collision"):
                link.remove(collision)
    merge_fixed_links(root, keep={fetch.ee_link})
    for mesh in root.iter("mesh"):
        mesh.set("filename", str((source.parent / mesh.get("filename", "")).resolve()))
    return ElementTree.tostring(root, encoding="unicode")


@cache
def _ignored_pairs(fetch: RobotSpec) -> str:
    """Returns the SRDF: link pairs without collision, `NEAR_PAIRS` included.

    Pairs with a merged link are left out; the engine ignores links next to each other by itself.
    """
    root = ElementTree.parse(fetch.urdf_path().with_suffix(".srdf")).getroot()
    robot = ElementTree.fromstring(_fetch_urdf(fetch, visuals=False))
    links = {link.get("name") for link in robot.iter("link")}
    for pair in root.findall("disable_collisions"):
        if not {pair.get("link1"), pair.get("link2")} <= links:
            root.remove(pair)
    for first, second in NEAR_PAIRS:
        ElementTree.SubElement(
            root, "disable_collisions", link1=first, link2=second, reason="Default"
        )
    return ElementTree.tostring(root, encoding="unicode")


@register_agent()
class HabFetch(MobileManipulator):
    """Fetch with torso, head and fingers locked as in the paper."""

    spec = FETCH
    uid = FETCH.uid

    def urdf(self, visuals: bool) -> str:
        """Returns ManiSkill's URDF without the collision shapes of the wheels."""
        return _fetch_urdf(self.spec, visuals)

    def srdf(self) -> str:
        """Returns ManiSkill's SRDF with `NEAR_PAIRS` added."""
        return _ignored_pairs(self.spec)


@register_agent()
class HabFetchFriction(HabFetch):
    """Fetch whose fingers grasp by friction."""

    spec = FETCH_FRICTION
    uid = FETCH_FRICTION.uid
