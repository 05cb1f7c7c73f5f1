"""Factory of SPA-Priv, for ``hab-eval run --agent hab_spa:spa_priv``."""

from __future__ import annotations

from hab_plans.motion import Motion

from hab_spa.agents.agent import Behaviour, SpaAgent, control_mode, planned, skill_asked
from hab_spa.motion.drive import DriveConfig, drive_to
from hab_spa.motion.robot import Robot
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.skills.drawer import close_drawer, open_drawer
from hab_spa.skills.fridge.skill import close_fridge, open_fridge
from hab_spa.skills.pick import pick
from hab_spa.skills.place import place
from hab_tasks.agent import AgentSetup, AgentSpec
from hab_tasks.articulations import FRIDGE

EMPTY_HANDED = DriveConfig(turn_first_rad=0.5, turn_share=1.0, waypoint_m=0.05)
"""Driving without a held object: full turning speed."""


def navigate(robot: Robot) -> Motion:
    """Drives to the goal of a Navigate episode and stops."""
    scene = robot.scene
    assert isinstance(scene, TrueScene)
    return (yield from drive_to(robot, scene.floor_map(), scene.state.base_goal, EMPTY_HANDED))


SKILLS: dict[str, Behaviour] = {
    "HabPick-v1": lambda robot: pick(robot, 0),
    "HabPlace-v1": lambda robot: place(robot, 0),
    "HabNavigate-v1": navigate,
    "HabOpenFridge-v1": lambda robot: open_fridge(robot, 0, FRIDGE.opening_region),
    "HabCloseFridge-v1": lambda robot: close_fridge(robot, 0, FRIDGE.closing_region),
    "HabOpenDrawer-v1": lambda robot: open_drawer(robot, 0),
    "HabCloseDrawer-v1": lambda robot: close_drawer(robot, 0),
}
"""Environment id -> behaviour."""


def spa_priv(setup: AgentSetup) -> SpaAgent:
    """Returns SPA-Priv: sense-plan-act in one skill, with the ground-truth scene geometry.

    Options: ``controller`` (``real`` or ``perfect``), ``planner`` (``ompl`` or ``batched``).

    Raises:
        UnknownNameError: The environment is not a supported skill, or an option is unknown.
    """
    env_id, skill = skill_asked(setup, "SPA-Priv", SKILLS)
    mode = control_mode(env_id, setup.options)
    spec = AgentSpec(name="SPA-Priv", control_mode=mode, privileged=True)
    return SpaAgent(setup, spec, TrueScene, skill, planned(setup))
