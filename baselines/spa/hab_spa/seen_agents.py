"""SPA in one skill: it knows the scene from depth images (S App. D)."""

from __future__ import annotations

from hab_spa.agent import Behaviour, SpaAgent
from hab_spa.look import LookConfig, look_around
from hab_spa.modes import CONTROLLERS, control_mode
from hab_spa.pick import pick
from hab_spa.robot import Motion, Robot
from hab_spa.seen_scene import SeenScene
from hab_tasks.agent import AgentSetup, AgentSpec, check_options
from hab_tasks.errors import UnknownNameError

SKILLS: dict[str, Behaviour] = {"HabPick-v1": lambda robot: pick(robot, 0)}
"""Environment id -> what the robot does in it when it has looked around."""


def looking(behave: Behaviour, config: LookConfig | None = None) -> Behaviour:
    """Returns a behaviour that begins by looking around."""
    config = config or LookConfig()

    def begin(robot: Robot) -> Motion:
        scene = robot.scene
        assert isinstance(scene, SeenScene)
        yield from look_around(robot, scene, config)
        return (yield from behave(robot))

    return begin


def spa(setup: AgentSetup) -> SpaAgent:
    """Makes SPA: one skill, with what depth images show.

    Option: ``controller`` (``real`` or ``perfect``).

    Raises:
        UnknownNameError: The environment is no skill that this agent can do, or an option is
            unknown.
    """
    check_options(setup, {"controller": CONTROLLERS})
    env_id = setup.env_id.rsplit(":", 1)[-1]
    if env_id not in SKILLS:
        raise UnknownNameError("environment of SPA", env_id, SKILLS)
    spec = AgentSpec(
        name="SPA",
        control_mode=control_mode(env_id, setup.options),
        obs_mode="depth",
        looks="on demand",
    )
    return SpaAgent(setup, spec, SeenScene, looking(SKILLS[env_id]))
