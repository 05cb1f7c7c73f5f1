"""Factory of TP+SPA-Priv: task plans executed by sense-plan-act (S 5, H.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from hab_plans.executor import Executor, ExecutorConfig, MotionLog
from hab_plans.motion import Motion
from hab_plans.plan import plan_of
from hab_plans.problem import PROVIDERS, load_factory, task_of
from hab_plans.protocols import Navigator, SkillProvider, Team

from hab_spa.agents.agent import CONTROLLERS, SpaAgent, control_mode, planned, robot_for
from hab_spa.motion.robot import Robot
from hab_spa.planning.arm_plan import PLANNERS
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.tasks.navigate import Folding, OracleNavigator, PolicyNavigator, navigator_of
from hab_spa.tasks.planned_skills import FRICTION_SKILLS, SKILLS
from hab_tasks.agent import AgentSetup, AgentSpec, check_options
from hab_tasks.errors import OptionError
from hab_tasks.registration import imported_id

EXECUTION = ExecutorConfig(attempts=4, replans=6, watches=True)

OPTIONS = {
    **{"navigation": None, "policy": None, "replan": None},
    **{"controller": CONTROLLERS, "planner": PLANNERS},
}


def tp_spa_priv(setup: AgentSetup) -> SpaAgent:
    """Returns TP+SPA-Priv: executes the task's plan with the ground-truth scene geometry.

    Options: ``navigation`` (``oracle``, ``perfect`` or ``module:factory``), ``policy`` (a file,
    for the latter), ``controller`` (``real`` or ``perfect``), ``planner`` (``ompl`` or
    ``batched``), ``replan`` (maximum number).

    Raises:
        HabError: The environment is not a task, or an option is unknown.
    """
    env_id, config = _asked(setup)
    navigator, own = navigator_of(setup), _own_skills(setup, env_id)
    skills = SKILLS if robot_for(setup).fingers is None else FRICTION_SKILLS

    def behave(robot: Robot) -> Motion:
        return _run(env_id, robot, skills, own, navigator, config)

    obs_mode = "state_dict"
    if isinstance(navigator, PolicyNavigator):
        obs_mode = navigator.spec.obs_mode
    spec = AgentSpec(
        name=_name("TP+SPA-Priv", setup),
        control_mode=control_mode(env_id, setup.options),
        obs_mode=obs_mode,
        # Only a learned navigator looks, and planned parts of the episode need no images.
        looks="always" if obs_mode == "state_dict" else "on demand",
        privileged=True,
        files=_files(navigator),
    )
    return SpaAgent(setup, spec, TrueScene, behave, planned(setup, by_friction=True))


def _run(
    env_id: str,
    robot: Robot,
    skills: Mapping[str, SkillProvider[Robot]],
    own: Mapping[str, SkillProvider[Robot]],
    navigator: Navigator[Robot],
    config: ExecutorConfig,
) -> Motion:
    """Returns the execution of a task's plan in one episode."""
    log = MotionLog(env_id, robot)
    team = Team(skills={**skills, **own}, navigator=navigator, hand_over=Folding(log))
    return Executor(log, team, config).run()


def _asked(setup: AgentSetup) -> tuple[str, ExecutorConfig]:
    """Returns the task's id and the executor's parameters."""
    check_options(setup, OPTIONS)
    env_id = imported_id(setup.env_id)
    task_of(env_id)
    text = setup.options.get("replan")
    if text is None:
        return env_id, EXECUTION
    if not text.isdecimal():
        raise OptionError.of_value("option replan of the agent", text, "an integer >= 0")
    return env_id, replace(EXECUTION, replans=int(text))


def _own_skills(setup: AgentSetup, env_id: str) -> dict[str, SkillProvider[Robot]]:
    """Returns the registered providers of the task's skills."""
    used = {action.skill for action in plan_of(env_id).interactions}
    return {skill: load_factory(by)(setup) for skill, by in PROVIDERS.items() if skill in used}


def _files(navigator: OracleNavigator | PolicyNavigator) -> tuple[str, ...]:
    """Returns the files of a learned navigator."""
    return navigator.spec.files if isinstance(navigator, PolicyNavigator) else ()


def _name(agent: str, setup: AgentSetup) -> str:
    return f"{agent} ({setup.options.get('navigation', 'oracle')} navigation)"
