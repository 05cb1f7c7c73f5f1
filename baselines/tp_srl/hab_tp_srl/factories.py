"""TP+SRL's agent and factory, for ``hab-eval run --agent hab_tp_srl:tp_srl`` (S 5, H.1, H.2).

The agent executes a plan in each row, and evaluates policies for all rows together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from hab_navigator.network import is_navigator
from hab_plans.executor import Executor, ExecutorConfig, MotionLog
from hab_plans.motion import Command, Motion
from hab_plans.plan import plan_of
from hab_plans.problem import PROVIDERS, load_factory, task_of
from hab_plans.protocols import Team
from hab_spa.agents.agent import SpaAgent
from hab_spa.motion.robot import Robot
from hab_spa.scenes.scene import Scene

from hab_tasks.agent import Agent, AgentReport, AgentSetup, AgentSpec
from hab_tasks.io.threads import use_one_thread
from hab_tasks.registration import imported_id
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.tasks.base import Task
from hab_tp_srl.hand_over import Resetting, ReturningNavigator
from hab_tp_srl.navigators import LearnedNavigator, NavigatorPolicy, ReturningOracle
from hab_tp_srl.options import SEEING, SKILLS, SPA, TeamOptions, read_options
from hab_tp_srl.policies import AgentPolicy, Decider, SkillPolicy
from hab_tp_srl.providers import Policies, providers
from hab_tp_srl.scenes import GuidedScene, ObservedScene
from hab_tp_srl.skill import PolicyCommand
from hab_tp_srl.view import TaskView


class TpSrlAgent(SpaAgent):
    """Runs the executor's motion in each row."""

    def decide(self, commands: list[Command], obs: Mapping[str, Any]) -> list[Command]:
        """Evaluates the policies of all running skills, each once."""
        asking: dict[Decider, list[int]] = {}
        for row, command in enumerate(commands):
            if isinstance(command, PolicyCommand):
                asking.setdefault(command.turn.policy, []).append(row)
        for policy, rows in asking.items():
            turns = [_asked(commands[row]).turn for row in rows]
            policy.decide(rows, turns, obs)
        return [c.result() if isinstance(c, PolicyCommand) else c for c in commands]

    def report(self) -> list[AgentReport]:
        """Returns each row's failed stage, planning times and stages so far."""
        return [replace(report, failure=fault(report.trace)) for report in super().report()]


def _asked(command: Command) -> PolicyCommand:
    assert isinstance(command, PolicyCommand)
    return command


def fault(trace: Sequence[dict[str, Any]]) -> str | None:
    """Returns the failure category of an episode: the first stage that was not achieved, and why.

    Args:
        trace: Trace of the robot; the last plan and each stage's last attempt count.

    Returns:
        E.g. ``pick timeout``, ``pick failed`` for a skill that ended without its effect, or
        ``navigate timeout``; with ``, new start`` if the skill began in a state that its training
        does not know. None if every stage was achieved.
    """
    tries = [entry for entry in trace if "stage" in entry]
    last = [entry for entry in tries if entry["plan"] == tries[-1]["plan"]]
    for place in sorted({entry["stage"] for entry in last}):
        here = [entry for entry in last if entry["stage"] == place]
        here = [entry for entry in here if entry["attempt"] == here[-1]["attempt"]]
        if here[-1].get("achieved"):
            continue
        for entry in here:
            outcome = entry.get("outcome", "timeout")
            if outcome != "done":
                return f"{entry['did']} {outcome}{_start_of(entry)}"
        return f"{here[-1]['did']} failed{_start_of(here[-1])}"
    return None


def _start_of(entry: Mapping[str, Any]) -> str:
    return ", new start" if entry.get("start") == "new" else ""


NavigationPolicy = SkillPolicy | NavigatorPolicy

FROM_SENSORS = {
    "skills": "depth",
    "navigation": "learned",
    "aim": "object",
    "pick": "spa+pick_fridge+pick_depth",
    "place": "spa+place_fridge+place_depth",
    "retries": "3",
    "replan": "5",
}
"""Options of `from_sensors`."""

ALL_BY_SPA = dict.fromkeys(("skills", "pick", "place"), SEEING)
"""Options of `spa_from_sensors` that differ from these."""

ROWS = 8
"""Episodes played at a time by a team without planned skills."""


def tp_srl(setup: AgentSetup) -> TpSrlAgent:
    """Returns TP+SRL: executes the task's plan with trained skills.

    Options: ``skills`` (``blind``, ``depth`` or ``spa_priv``) and, for single skills, ``pick``,
    ``place``, ``open_drawer``, ... (``spa_priv``, a recipe whose weights ship, or a path);
    ``navigation`` (``oracle``, ``perfect`` or ``learned``) and ``navigate`` (weights for the
    latter); ``knowledge`` (``observed`` or ``true``); ``aim`` (``hand`` or ``object``);
    ``reset_arm`` (``on`` or ``off``); ``actions`` (``likely`` or ``drawn``); ``retries`` and
    ``replan`` (maximum numbers).

    Raises:
        HabError: The environment is not a task, an option is unknown, or weights cannot be used.
    """
    env_id = imported_id(setup.env_id)
    task = task_of(env_id)
    use_one_thread()
    options = read_options(setup, skills_of(env_id, task))
    policies = _policies(setup, options)
    navigate = None if options.navigate is None else _navigation(setup, options.navigate)
    spec = _spec(options, policies, navigate)

    def make_scene(robot: RobotSpec) -> Scene:
        view = _view(task, options, "depth" in spec.obs_mode)
        if options.privileged:
            return GuidedScene(robot, view)
        # Learned skills and the arm's reset use no more of a scene than this.
        return cast(Scene, ObservedScene(robot, view))

    def behave(robot: Robot) -> Motion:
        scene = robot.scene
        assert isinstance(scene, GuidedScene | ObservedScene)
        log = MotionLog(env_id, robot, believes=options.privileged or options.feels)
        navigator = _navigator(policies, navigate, scene.view)
        team = Team(
            skills=providers(task, policies, scene.view, options.knows_effects),
            navigator=navigator,
            hand_over=Resetting(
                log=log, options=options, navigator=navigator, learned=_learned(policies)
            ),
        )
        config = ExecutorConfig(
            attempts=1 + options.retries,
            replans=options.replans,
            leaves=options.feels,
            goes_on=True,
        )
        return Executor(log, team, config).run()

    return TpSrlAgent(setup, spec, make_scene, behave)


def from_sensors(setup: AgentSetup) -> TpSrlAgent:
    """Returns TP+SRL that reads nothing but its sensors and what the task tells at the start.

    Options are those of `tp_srl`; these are its own: depth policies, learned navigation, and plans
    made again from what the robot has felt and seen.

    Raises:
        HabError: As `tp_srl`.
    """
    return tp_srl(replace(setup, options={**FROM_SENSORS, **setup.options}))


def spa_from_sensors(setup: AgentSetup) -> TpSrlAgent:
    """Returns `from_sensors` with every skill by sense-plan-act from depth.

    Only navigation is learned. Options are those of `tp_srl`.

    Raises:
        HabError: As `tp_srl`.
    """
    return from_sensors(replace(setup, options={**ALL_BY_SPA, **setup.options}))


def _view(task: Task, options: TeamOptions, sees: bool) -> TaskView:
    """Returns the view of a robot in a task, which may have images."""
    spec = task.spec
    return TaskView(
        truth=options.true_knowledge,
        aims_object=options.aims_object,
        openings=["open" if one in spec.starts_open else "closed" for one in spec.articulations],
        inside=[None if t.inside is None else spec.number(t.inside) for t in spec.targets],
        feels=options.feels,
        sees=sees,
    )


def skills_of(env_id: str, task: Task) -> tuple[str, ...]:
    """Returns the skills that a task's plans can need, other than navigation."""
    used = {action.skill for action in plan_of(env_id).interactions}
    used |= {f"open_{kind.name}" for kind in task.articulations}
    return tuple(skill for skill in (*SKILLS, *PROVIDERS) if skill in used)


def _policies(setup: AgentSetup, options: TeamOptions) -> Policies:
    """Loads the policies; a file that several skills use is loaded for each."""
    return {
        skill: [_policy(setup, skill, one, options) for one in by]
        for skill, by in options.skills.items()
    }


def _policy(setup: AgentSetup, skill: str, by: Path | str | None, options: TeamOptions) -> Any:
    """Loads who executes a skill."""
    if isinstance(by, str):
        own = load_factory(by)(setup) if PROVIDERS.get(skill) == by else None
        if own is None or isinstance(own, Agent):
            plans = by == SPA
            return AgentPolicy(setup, skill, by, {"planner": "batched"} if plans else {}, plans)
        return own
    return None if by is None else SkillPolicy(setup, skill, by, options.draws_actions)


def _learned(policies: Policies) -> dict[str, SkillPolicy | AgentPolicy]:
    """Returns who first executes each skill that is not planned."""
    first = {skill: one for skill, (one, *_) in policies.items()}
    return {
        skill: one for skill, one in first.items() if isinstance(one, SkillPolicy | AgentPolicy)
    }


def _navigator(
    policies: Policies, navigate: NavigationPolicy | None, view: TaskView
) -> ReturningNavigator:
    """Returns the navigator of an episode."""
    if navigate is None:
        return ReturningOracle()
    return LearnedNavigator(navigate, _learned(policies), view)


def _navigation(setup: AgentSetup, path: Path) -> NavigationPolicy:
    """Loads the policy of learned navigation."""
    if is_navigator(path):
        return NavigatorPolicy(setup, path)
    return SkillPolicy(setup, "navigate", path)


def _spec(options: TeamOptions, policies: Policies, navigate: NavigationPolicy | None) -> AgentSpec:
    """Returns the environment options that a team needs."""
    every = [one for ones in policies.values() for one in ones]
    learned = [one for one in every if isinstance(one, SkillPolicy | AgentPolicy)]
    agents = [one for one in learned if isinstance(one, AgentPolicy)]
    whole = len(learned) == len(every)
    learned += [] if navigate is None else [navigate]
    seeing = [policy for policy in learned if policy.sees_images]
    textures = {texture for policy in seeing for texture in policy.obs_mode.split("+")}
    paths = [*(path for by in options.skills.values() for path in by), options.navigate]
    perfect = options.navigation == "perfect"
    return AgentSpec(
        name=_name(options),
        control_mode="joint_target_pose" if perfect else "joint_target_base",
        obs_mode="+".join(sorted(textures)) or "state_dict",
        privileged=options.privileged,
        # Most parts need no images, and the navigator only some.
        looks="on demand" if seeing else "always",
        handle_position=not options.true_knowledge and any(p.sees_handles for p in learned),
        rows=ROWS if whole else 1,
        files=tuple(str(path) for path in paths if isinstance(path, Path))
        + tuple(file for one in agents for file in one.files),
    )


def _name(options: TeamOptions) -> str:
    """Returns the displayed name; recovery and planned skills are part of it."""
    parts = [f"{options.navigation} navigation"]
    planned = [skill for skill, by in options.skills.items() if None in by]
    if planned:
        everything = len(planned) == len(options.skills)
        parts.append(f"{'all skills' if everything else ', '.join(planned)} by SPA-Priv")
    parts += ["all skills by SPA"] * all(list(by) == [SPA] for by in options.skills.values())
    parts += ["aims by the object"] * options.aims_object
    parts += ["arm not reset"] * (not options.resets_arm)
    parts += ["actions drawn"] * options.draws_actions
    parts += [f"{options.retries} retries"] * (options.retries > 0)
    parts += [f"{options.replans} replans"] * (options.replans > 0)
    return f"TP+SRL ({'; '.join(parts)})"
