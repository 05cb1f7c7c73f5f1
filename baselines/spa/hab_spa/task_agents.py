"""TP+SPA-Priv: task plans carried out by sense-plan-act (S 5, H.1)."""

from __future__ import annotations

from dataclasses import replace

from hab_planner.problem import task_of

from hab_spa.agent import SpaAgent
from hab_spa.executor import Executor, TaskConfig
from hab_spa.modes import CONTROLLERS, control_mode
from hab_spa.navigate import navigator_of
from hab_spa.robot import Motion, Robot
from hab_spa.true_scene import TrueScene
from hab_tasks.agent import AgentSetup, AgentSpec, check_options
from hab_tasks.errors import OptionError

OPTIONS = {"navigation": None, "controller": CONTROLLERS, "policy": None, "replan": None}


def tp_spa_priv(setup: AgentSetup) -> SpaAgent:
    """Makes TP+SPA-Priv: the task's plan, with the true geometry of the scene.

    Options: ``navigation`` (``oracle``, ``teleport`` or ``module:factory``), ``policy`` (a file,
    for the latter), ``controller`` (``real`` or ``perfect``), ``replan`` (how often).

    Raises:
        HabError: The environment is no task, or an option is unknown.
    """
    check_options(setup, OPTIONS)
    env_id = setup.env_id.rsplit(":", 1)[-1]
    task_of(env_id)
    navigation = setup.options.get("navigation", "oracle")
    navigator, config = navigator_of(setup), replace(TaskConfig(), **_replans(setup))

    def behave(robot: Robot) -> Motion:
        return Executor(env_id, robot, navigator, config).run()

    spec = AgentSpec(
        name=f"TP+SPA-Priv ({navigation} navigation)",
        control_mode=control_mode(env_id, setup.options),
        privileged=True,
    )
    return SpaAgent(setup, spec, TrueScene, behave)


def _replans(setup: AgentSetup) -> dict[str, int]:
    text = setup.options.get("replan")
    if text is None:
        return {}
    if not text.isdecimal():
        raise OptionError("option replan of the agent", text, "a number from 0")
    return {"replans": int(text)}
