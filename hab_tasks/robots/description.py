"""A robot's URDF and SRDF: as they are for kinematics, and as the simulator loads them."""

from __future__ import annotations

from functools import cache
from xml.etree import ElementTree

from hab_tasks.robots.light_visuals import lighten
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.scenes.fixed_links import merge_fixed_links
from hab_tasks.world.scenes.urdf import remove_visuals


@cache
def simulated_urdf(robot: RobotSpec, visuals: bool) -> str:
    """Returns the URDF for the simulator, with light visuals or without visuals.

    Links on fixed joints are merged into the link that carries them: the engine would simulate
    each of them in every step.
    """
    root = robot.urdf_tree()
    if visuals:
        lighten(root)
    else:
        remove_visuals(root)
    for link in root.iter("link"):
        if link.get("name", "") in robot.shapeless_links:
            for collision in link.findall("collision"):
                link.remove(collision)
    merge_fixed_links(root, keep={robot.ee_link})
    return ElementTree.tostring(root, encoding="unicode")


@cache
def simulated_srdf(robot: RobotSpec) -> str:
    """Returns the SRDF: link pairs without collision, `RobotSpec.near_pairs` included.

    Pairs with a merged link are left out; the engine ignores links next to each other by itself.
    """
    root = robot.srdf_tree()
    merged = ElementTree.fromstring(simulated_urdf(robot, visuals=False))
    links = {link.get("name") for link in merged.iter("link")}
    for pair in root.findall("disable_collisions"):
        if not {pair.get("link1"), pair.get("link2")} <= links:
            root.remove(pair)
    for first, second in robot.near_pairs:
        ElementTree.SubElement(
            root, "disable_collisions", link1=first, link2=second, reason="Default"
        )
    return ElementTree.tostring(root, encoding="unicode")


@cache
def ignored_pairs(robot: RobotSpec) -> frozenset[frozenset[str]]:
    """Returns the link pairs that planners do not check: adjacent links, and those of the SRDF."""
    trees = robot.urdf_tree(), ElementTree.fromstring(simulated_urdf(robot, visuals=False))
    pairs = {
        frozenset(joint.find(end).get("link", "") for end in ("parent", "child"))  # type: ignore[union-attr]
        for tree in trees
        for joint in tree.iter("joint")
    }
    for entry in robot.srdf_tree().iter("disable_collisions"):
        pairs.add(frozenset((entry.get("link1", ""), entry.get("link2", ""))))
    return frozenset(pairs)
