"""Factories of SPA-Priv and SPA, and SPA's skills, which perceive depth images (S App. D)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from hab_plans.motion import Failure, Motion

from hab_spa.agents.agent import (
    Behaviour,
    SpaAgent,
    control_mode,
    planned,
    robot_for,
    skill_asked,
)
from hab_spa.motion.drive import DriveConfig, drive_to
from hab_spa.motion.follow import FollowConfig
from hab_spa.motion.moves import draw_out, rest
from hab_spa.motion.robot import Robot, SpaConfig
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.planning.joint_goal import GoalConfig
from hab_spa.scenes.seen_furniture import SeenDrawer, SeenFridge
from hab_spa.scenes.seen_scene import SeenScene
from hab_spa.scenes.seen_shelves import SeenShelves
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.skills.drawer import DrawerConfig, close_drawer, open_drawer
from hab_spa.skills.friction_drawer import close_drawer_by_friction, open_drawer_by_friction
from hab_spa.skills.friction_fridge import close_fridge_by_friction, open_fridge_by_friction
from hab_spa.skills.friction_pick import pick_by_friction
from hab_spa.skills.fridge.config import FridgeConfig
from hab_spa.skills.fridge.skill import close_fridge, open_fridge
from hab_spa.skills.look import LookConfig, look_again, look_around, look_at, look_closer
from hab_spa.skills.pick import pick
from hab_spa.skills.place import place
from hab_tasks.agent import AgentSetup, AgentSpec
from hab_tasks.articulations import FRIDGE, Rectangle

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

FRICTION_SKILLS: dict[str, Behaviour] = {
    "HabPick-v1": lambda robot: pick_by_friction(robot, 0),
    "HabPlace-v1": lambda robot: place(robot, 0),
    "HabOpenFridge-v1": lambda robot: open_fridge_by_friction(robot, 0, FRIDGE.opening_region),
    "HabCloseFridge-v1": lambda robot: close_fridge_by_friction(robot, 0, FRIDGE.closing_region),
    "HabOpenDrawer-v1": lambda robot: open_drawer_by_friction(robot, 0),
    "HabCloseDrawer-v1": lambda robot: close_drawer_by_friction(robot, 0),
}
"""Likewise, with fingers that grasp by friction."""


def spa_priv(setup: AgentSetup) -> SpaAgent:
    """Returns SPA-Priv: sense-plan-act in one skill, with the ground-truth scene geometry.

    Options: ``controller`` (``real`` or ``perfect``), ``planner`` (``ompl`` or ``batched``).

    Raises:
        UnknownNameError: The environment is not a supported skill, or an option is unknown.
    """
    grips = robot_for(setup).fingers is not None
    who = f"SPA-Priv{' with grasp=friction' * grips}"
    env_id, skill = skill_asked(setup, who, FRICTION_SKILLS if grips else SKILLS)
    mode = control_mode(env_id, setup.options)
    spec = AgentSpec(name="SPA-Priv", control_mode=mode, privileged=True)
    return SpaAgent(setup, spec, TrueScene, skill, planned(setup, by_friction=True))


SPA_CONFIG = SpaConfig(
    retries=0,
    goal=GoalConfig(rest_radius_m=0.12, rest_spread_rad=0.7),
    plan=PlanConfig(time_limit_s=10.0, improve_checks=1_500, most_checks=12_000),
    follow=FollowConfig(bump_rad=0.008),
)
"""Parameters of SPA. The arm stops for obstacles that are seen or felt during a motion. Resting
goals are relaxed, as the fitted box of an object is often too wide for the exact pose; the tasks
allow 0.15 m. Failures are retried by `_with_retries`, not by the skills."""

ATTEMPTS = 24
"""Maximum attempts per skill; the arm stops for every new obstacle."""

MORE_LOOKS, LOOK_STEPS = 3, 60
"""Maximum number of further looks where no plan is found, and steps that have to be left."""

MOST_RISK_LEVEL = 2
"""See `SeenScene`."""


def spa_config(setup: AgentSetup) -> SpaConfig:
    """Returns the parameters of SPA for the options ``controller`` and ``planner``."""
    perfect = setup.options.get("controller") == "perfect"
    # There is no contact feedback when joint states are set directly.
    config = replace(SPA_CONFIG, follow=FollowConfig()) if perfect else SPA_CONFIG
    return planned(setup, config)


def pick_seen(robot: Robot, number: int) -> Motion:
    """Looks for an object of the episode, then picks it."""
    scene, config = _shelves(robot), LookConfig()
    yield from look_around(robot, scene, config)
    scene.look_into(scene.object_m(number))
    yield from look_closer(robot, scene, number, config)
    return (yield from _with_looks(robot, pick, number))


def place_seen(robot: Robot, number: int) -> Motion:
    """Looks around, then places the held object at its goal, or beside it if that fails."""
    scene = _shelves(robot)
    robot.held_up = scene.held_up
    yield from look_around(robot, scene, LookConfig())
    scene.look_into(scene.goal_m(number))

    def place_near(robot: Robot, number: int) -> Motion:
        return place(robot, number, loose=scene.risk_level > 0)

    return (yield from _with_looks(robot, place_near, number))


def open_fridge_seen(robot: Robot, number: int) -> Motion:
    """Finds the fridge, then opens it."""
    return (yield from _fridge_seen(robot, number, open_fridge, FRIDGE.opening_region))


def close_fridge_seen(robot: Robot, number: int) -> Motion:
    """Finds the fridge and how far it is open, then closes it."""
    return (yield from _fridge_seen(robot, number, close_fridge, FRIDGE.closing_region))


def _fridge_seen(
    robot: Robot, number: int, skill: Callable[..., Motion], region: Rectangle
) -> Motion:
    scene = robot.scene
    assert isinstance(scene, SeenFridge)
    opened = skill is close_fridge
    if not scene.find(opened):
        yield from look_at(robot, scene.object_m(0))
        if not scene.find(opened):
            return Failure.TARGET_PLAN
    # How far a door is open is known to a few hundredths of a radian.
    config = FridgeConfig(
        slack_rad=0.05,
        near_first=opened,
        open_to=1.95,
        opened=1.72,
        let_go=1.84,
        back_rad=0.15,
        plan_tries=1,
    )
    failure = yield from _with_retries(
        robot, lambda r, n: skill(r, n, region, config), number, risk=1
    )
    if failure is not None and failure is not Failure.EXECUTION:
        # Beside an open door there may be no path to rest that is seen to be free.
        yield from draw_out(robot, robot.config.follow.settled_rad)
        yield from rest(robot, without=scene.articulation(number).body)
    return failure


def drawer_seen(robot: Robot, number: int, skill: Callable[..., Motion]) -> Motion:
    """Finds the drawer, then opens or closes it by a skill."""
    scene = robot.scene
    assert isinstance(scene, SeenDrawer)
    opened = skill is close_drawer
    if not scene.find(opened):
        yield from look_around(robot, scene, LookConfig())
        if not scene.find(opened):
            return Failure.TARGET_PLAN
    # The line ends beyond the stop: how far a drawer stands out is known to a few centimetres.
    config = DrawerConfig(
        rounds=8, open_share=1.16 if opened else 1.05, spare_m=0.03 if opened else 0.01
    )
    return (yield from _with_retries(robot, lambda r, n: skill(r, n, config), number, risk=1))


def _with_looks(robot: Robot, skill: Callable[[Robot, int], Motion], number: int) -> Motion:
    """Retries a skill; where no plan is found, looks from another arm pose and tries again."""
    failure = yield from _with_retries(robot, skill, number)
    for _ in range(MORE_LOOKS):
        if failure in (None, Failure.EXECUTION) or robot.steps_left < LOOK_STEPS:
            break
        yield from look_again(robot, _scene(robot), LookConfig())
        failure = yield from _with_retries(robot, skill, number)
    return failure


def _with_retries(
    robot: Robot, skill: Callable[[Robot, int], Motion], number: int, risk: int = 0
) -> Motion:
    """Retries a skill when execution fails, and at a higher risk level when planning fails."""
    scene = _scene(robot)
    scene.risk_level = risk
    failure: Failure | None = None
    for _ in range(ATTEMPTS):
        failure = yield from skill(robot, number)
        if failure is None or (
            failure is not Failure.EXECUTION and scene.risk_level == MOST_RISK_LEVEL
        ):
            break
        # What was met since is worth a plan around it.
        risky = failure is not Failure.EXECUTION
        scene.risk_level = scene.risk_level + 1 if risky else min(scene.risk_level, 1)
    scene.risk_level = 0
    return failure


def _scene(robot: Robot) -> SeenScene:
    assert isinstance(robot.scene, SeenScene)
    return robot.scene


def _shelves(robot: Robot) -> SeenShelves:
    assert isinstance(robot.scene, SeenShelves)
    return robot.scene


SEEN_SKILLS: dict[str, Behaviour] = {
    "HabPick-v1": lambda robot: pick_seen(robot, 0),
    "HabPlace-v1": lambda robot: place_seen(robot, 0),
    "HabOpenFridge-v1": lambda robot: open_fridge_seen(robot, 0),
    "HabCloseFridge-v1": lambda robot: close_fridge_seen(robot, 0),
    "HabOpenDrawer-v1": lambda robot: drawer_seen(robot, 0, open_drawer),
    "HabCloseDrawer-v1": lambda robot: drawer_seen(robot, 0, close_drawer),
}
"""Environment id -> behaviour."""


def spa(setup: AgentSetup) -> SpaAgent:
    """Returns SPA: sense-plan-act in one skill, with perception from depth images.

    Options: ``controller`` (``real`` or ``perfect``), ``planner`` (``ompl`` or ``batched``).

    Raises:
        UnknownNameError: The environment is not a supported skill, or an option is unknown.
    """
    env_id, skill = skill_asked(setup, "SPA", SEEN_SKILLS)
    spec = AgentSpec(
        name="SPA",
        control_mode=control_mode(env_id, setup.options),
        obs_mode="depth",
        looks="on demand",
    )
    scenes = {"Fridge": SeenFridge, "Drawer": SeenDrawer}
    scene = next((scenes[name] for name in scenes if name in env_id), SeenShelves)
    return SpaAgent(setup, spec, scene, skill, spa_config(setup))
