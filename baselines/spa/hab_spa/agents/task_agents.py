"""Factories of TP+SPA-Priv and TP+SPA: task plans executed by sense-plan-act (S 5, H.1)."""

from __future__ import annotations

from dataclasses import replace

from hab_plans.problem import task_of

from hab_spa.agents.agent import SpaAgent
from hab_spa.agents.modes import CONTROLLERS, control_mode
from hab_spa.agents.seen_agents import pick_seen, place_seen, spa_config
from hab_spa.motion.robot import Motion, Robot
from hab_spa.scenes.seen_scene import SeenScene
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.tasks.executor import Executor, TaskConfig
from hab_spa.tasks.interactions import Hands
from hab_spa.tasks.navigate import Navigator, PolicyNavigator, navigator_of
from hab_tasks.agent import AgentSetup, AgentSpec, check_options
from hab_tasks.errors import OptionError
from hab_tasks.registration import imported_id

OPTIONS = {"navigation": None, "controller": CONTROLLERS, "policy": None, "replan": None}


def tp_spa_priv(setup: AgentSetup) -> SpaAgent:
    """Returns TP+SPA-Priv: executes the task's plan with the ground-truth scene geometry.

    Options: ``navigation`` (``oracle``, ``perfect`` or ``module:factory``), ``policy`` (a file,
    for the latter), ``controller`` (``real`` or ``perfect``), ``replan`` (maximum number).

    Raises:
        HabError: The environment is not a task, or an option is unknown.
    """
    env_id, config = _asked(setup)
    navigator = navigator_of(setup)

    def behave(robot: Robot) -> Motion:
        return Executor(env_id, robot, navigator, config, Hands()).run()

    # Only a learned navigator looks, and planned parts of the episode need no images.
    looks = isinstance(navigator, PolicyNavigator) and navigator.spec.obs_mode != "state_dict"
    spec = AgentSpec(
        name=_name("TP+SPA-Priv", setup),
        control_mode=control_mode(env_id, setup.options),
        obs_mode=navigator.spec.obs_mode if looks else "state_dict",
        looks="on demand" if looks else "always",
        privileged=True,
        files=_files(navigator),
    )
    return SpaAgent(setup, spec, TrueScene, behave)


def tp_spa(setup: AgentSetup) -> SpaAgent:
    """Returns TP+SPA: executes the task's plan with perception from depth images.

    The ground-truth state is used only for oracle navigation and for the poses of doors and
    drawers, on which S App. D is silent. The options are those of `tp_spa_priv`.

    Raises:
        HabError: The environment is not a task, or an option is unknown.
    """
    env_id, config = _asked(setup)
    navigator = navigator_of(setup)

    def behave(robot: Robot) -> Motion:
        scene = robot.scene
        assert isinstance(scene, SeenScene)
        guide = Robot(scene.truth, robot.config, seed=robot.next_seed(), deadline=robot.deadline)
        hands = Hands(pick=pick_seen, place=place_seen)
        return Executor(env_id, robot, navigator, config, hands, guide).run()

    spec = AgentSpec(
        name=_name("TP+SPA", setup),
        control_mode=control_mode(env_id, setup.options),
        obs_mode="depth",
        looks="on demand",
        privileged=True,
        files=_files(navigator),
    )
    return SpaAgent(setup, spec, SeenScene, behave, spa_config(setup))


def _asked(setup: AgentSetup) -> tuple[str, TaskConfig]:
    """Returns the task's id and the executor's parameters."""
    check_options(setup, OPTIONS)
    env_id = imported_id(setup.env_id)
    task_of(env_id)
    text = setup.options.get("replan")
    if text is None:
        return env_id, TaskConfig()
    if not text.isdecimal():
        raise OptionError.of_value("option replan of the agent", text, "an integer >= 0")
    return env_id, replace(TaskConfig(), replans=int(text))


def _files(navigator: Navigator) -> tuple[str, ...]:
    """Returns the files of a learned navigator."""
    return navigator.spec.files if isinstance(navigator, PolicyNavigator) else ()


def _name(agent: str, setup: AgentSetup) -> str:
    return f"{agent} ({setup.options.get('navigation', 'oracle')} navigation)"
