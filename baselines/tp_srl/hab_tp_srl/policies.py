"""Trained skills, evaluated for several rows at a time; any agent of a skill as one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
import torch
from gymnasium import spaces
from hab_eval.run.agents import load_agent
from hab_navigator.belief import Reach
from hab_ppo.actions import RowNoise
from hab_ppo.agent import load_policy
from hab_ppo.checkpoint import PolicyFileError
from hab_spa.sensing.fitted_box import HELD_UP
from numpy.typing import NDArray

from hab_tasks.agent import Agent, AgentSetup, of_rows
from hab_tasks.engine.sensors import ARM_QPOS
from hab_tasks.engine.skill_env import SkillEnv
from hab_tasks.envs import ENVS
from hab_tasks.errors import OptionError
from hab_tasks.registration import SKILLS, TASK_SKILLS, imported_id
from hab_tasks.robots.control import HabControllerConfig, control_configs
from hab_tasks.skills.navigate import NAVIGATE_ID
from hab_tp_srl.base_poses import start_ranges
from hab_tp_srl.view import Entries

STILL_STEPS, MOTION_RAD = 20, 0.004
"""An arm that for so many steps moves no joint more than this per step is stuck. Then so many
actions are drawn, as in training, where a hand over its goal would also open by chance."""


@dataclass
class Stillness:
    """How long an arm has stood still.

    Attributes:
        arm_rad: (J,) the joints in the last step.
        still_steps: Number of steps since they moved, or since actions were last drawn for it.
        draws_left: Number of actions still to be drawn.
    """

    arm_rad: NDArray[np.float32] | None = None
    still_steps: int = 0
    draws_left: int = 0

    def draws(self, arm_rad: NDArray[np.float32]) -> bool:
        """Whether the action of this step is drawn; to be called in every step.

        Args:
            arm_rad: (J,) the joints.
        """
        before, self.arm_rad = self.arm_rad, arm_rad.copy()
        moves = before is None or np.abs(arm_rad - before).max() > MOTION_RAD
        self.still_steps = 0 if moves or self.draws_left else self.still_steps + 1
        if self.still_steps == STILL_STEPS:
            self.still_steps, self.draws_left = 0, STILL_STEPS
        drawn = self.draws_left > 0
        self.draws_left -= drawn
        return drawn


ARMS = ("ee", "joint_delta", "joint_target", "still")
BASES = ("still", "velocity", "discrete")
"""Arm and base modes of skills; all of them can be carried out by joint targets and velocities."""

TASK_ENTRIES = (
    *("point_in_base", "point_in_ee", "handle_from_ee"),
    *("object_start_from_ee", "object_start_in_ee", "object_goal_from_ee", "object_goal_in_ee"),
)
"""Entries of ``extra`` that a skill can observe in a task; see `TaskView.entries`."""


class Decider(Protocol):
    """What a learned skill has to offer."""

    name: str
    horizon_steps: int
    control: HabControllerConfig
    finds_held: bool

    def goes_on(self, turn: Turn) -> bool:
        """See `SkillPolicy.goes_on`."""
        ...

    def decide(self, rows: Sequence[int], turns: Sequence[Turn], obs: Mapping[str, Any]) -> None:
        """See `SkillPolicy.decide`."""
        ...


@dataclass(kw_only=True, eq=False)
class Turn:
    """A running skill of one row.

    Attributes:
        policy: Its policy.
        entries: The state observation of this step.
        base: (3,) x, y [m] and yaw [rad] of the base in this step, in a frame that does not move;
            for navigation only.
        before: The last navigation of this episode.
        reach: Where the skill after a navigation can start; None for any pose.
        memory: (2, H) state of the LSTM, or what else the policy keeps; None at the start of the
            skill.
        random: Draws actions.
        stillness: Tells when an arm that stands still needs them drawn.
        age: Number of actions so far.
        action: (A,) the action of this step, after `SkillPolicy.decide`.
        gave_up: Whether the policy has told that it failed.
    """

    policy: Decider
    entries: Entries = field(default_factory=dict)
    base: NDArray[np.float64] | None = None
    before: Turn | None = None
    reach: Reach | None = None
    memory: Any = None
    random: np.random.Generator | None = None
    stillness: Stillness = field(default_factory=Stillness)
    age: int = 0
    action: NDArray[Any] = field(default_factory=lambda: np.zeros(0, dtype=np.float32))
    gave_up: bool = False


class SkillPolicy:
    """A trained skill.

    Attributes:
        name: Name of its recipe.
        recipe: The recipe.
        horizon_steps: Maximum number of steps of the skill.
        control: Its control mode.
        draws_actions: Whether its actions are drawn.
        starts: Ranges of the starts that its training knows; None if they are unknown.
    """

    finds_held = False

    def __init__(self, setup: AgentSetup, skill: str, path: Path, draws: bool = False) -> None:
        """Loads a skill's weights.

        Args:
            setup: Setup of the task's agent.
            skill: Name of the skill, e.g. ``pick``.
            path: File of weights.
            draws: Whether actions are drawn, also those of a policy whose recipe takes the most
                likely ones.

        Raises:
            PolicyFileError: The file cannot be used, or is of another skill.
        """
        self._policy, self.recipe = load_policy(setup, path)
        self._device, self.name = setup.device, self.recipe.name
        self.draws_actions = draws or self.recipe.draws_actions
        env_id = imported_id(self.recipe.env.reference)
        env = ENVS[env_id].env
        self.horizon_steps = env.horizon_steps
        self.control: HabControllerConfig = control_configs(env.robot)[self.recipe.env.control_mode]
        self._check(skill, env_id, path)
        self.starts = start_ranges(env_id, env.robot) if env_id != NAVIGATE_ID else None

    def _check(self, skill: str, env_id: str, path: Path) -> None:
        """Checks that the policy can act as a skill in a task."""
        env, control_mode = ENVS[env_id].env, self.recipe.env.control_mode
        trained = env.skill.name if issubclass(env, SkillEnv) else None
        if trained is None or (env_id in SKILLS and trained != skill):
            raise PolicyFileError(f"{path} was trained in {env_id}; option {skill} needs {skill}.")
        if self.control.arm not in ARMS or self.control.base not in BASES:
            raise PolicyFileError(
                f"{path} acts by control_mode {control_mode}, which sets joint states or base "
                "poses directly; a skill of a task must drive the joints."
            )
        absent = [
            name
            for group, name in self._policy.layout.state
            if group == "extra" and name not in TASK_ENTRIES
        ]
        if absent:
            raise PolicyFileError(f"{path} observes {absent[0]}, which a task does not tell.")

    @property
    def sees_handles(self) -> bool:
        """Whether it observes the handle of a door or drawer."""
        return ("extra", "handle_from_ee") in self._policy.layout.state

    @property
    def obs_mode(self) -> str:
        """The observation that it needs."""
        return self.recipe.env.obs_mode

    def goes_on(self, turn: Turn) -> bool:
        """Whether a further attempt goes on with what the last one left; here it starts anew."""
        return False

    @property
    def sees_images(self) -> bool:
        """Whether it observes images."""
        return self._policy.layout.image_shape is not None

    def decide(self, rows: Sequence[int], turns: Sequence[Turn], obs: Mapping[str, Any]) -> None:
        """Chooses the actions of some rows; stores them and the memories.

        A policy with `EnvConfig.action_repeat` chooses every so many steps, and repeats its action.

        Args:
            rows: Their numbers.
            turns: Their running skills.
            obs: The task's observation of all rows.
        """
        due = [turn.age % self.recipe.env.action_repeat == 0 for turn in turns]
        for turn in turns:
            turn.age += 1
        rows = [row for row, chooses in zip(rows, due, strict=True) if chooses]
        turns = [turn for turn, chooses in zip(turns, due, strict=True) if chooses]
        if not turns:
            return
        seen = self._policy.layout.read(self._observed(rows, turns, obs)).to(self._device)
        starts = torch.tensor([turn.memory is None for turn in turns], device=self._device)
        blank = self._policy.no_memory(1)[:, 0]
        memory = torch.stack([blank if t.memory is None else t.memory for t in turns], dim=1)
        draws = [self._draws(turn) for turn in turns]
        # Only of the rows that draw: a row's numbers must not depend on the other rows.
        drawing = [t.random if draw else None for t, draw in zip(turns, draws, strict=True)]
        noise = RowNoise(drawing) if any(draws) else None
        acted = self._policy.choose(seen, memory, starts, noise)
        actions = self._policy.head.to_env(acted.actions).reshape(len(turns), -1)
        if any(draws) and not all(draws):
            likely = self._policy.choose(seen, memory, starts).actions
            likely = self._policy.head.to_env(likely).reshape(len(turns), -1)
            actions = np.where(np.array(draws)[:, None], actions, likely)
        for number, turn in enumerate(turns):
            turn.action, turn.memory = actions[number], acted.memory[:, number]

    def _draws(self, turn: Turn) -> bool:
        """Whether a turn's action of this step is drawn."""
        only_arm = self.control.arm != "still" and self.control.base == "still"
        stuck = only_arm and turn.stillness.draws(turn.entries["agent", ARM_QPOS.name])
        return self.draws_actions or stuck

    def _observed(
        self, rows: Sequence[int], turns: Sequence[Turn], obs: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Returns the nested observation of some rows, as the skill's environment gives it."""
        nested: dict[str, Any] = {}
        for group, name in self._policy.layout.state:
            values = [turn.entries[group, name] for turn in turns]
            nested.setdefault(group, {})[name] = np.stack(values)
        chosen = of_rows(obs, rows) if self.sees_images else {}
        for group, camera, texture in self._policy.layout.images:
            image = chosen[group][camera][texture]
            nested.setdefault(group, {}).setdefault(camera, {})[texture] = image
        return nested


class AgentPolicy:
    """Runs an agent of its own for each row; the attributes are those of `SkillPolicy`."""

    def __init__(
        self,
        setup: AgentSetup,
        skill: str,
        reference: str,
        options: Mapping[str, str],
        finds_held: bool = False,
    ) -> None:
        """Loads the agent.

        Args:
            setup: Setup of the task's agent; its options are not passed on.
            skill: Name of the skill in tasks.
            reference: ``module:factory``.
            options: Options of the agent.
            finds_held: Whether it finds by itself where an object is in the hand. Then it also
                observes `HELD_UP`, which its own environment does not have.

        Raises:
            HabError: The agent cannot be loaded, or it cannot act in a task.
        """
        named = {ENVS[env_id].env.name: env_id for env_id in SKILLS} | TASK_SKILLS
        inner = replace(setup, env_id=named[skill], options=dict(options))
        self._make, self.finds_held = partial(load_agent, reference, inner), finds_held
        self._more_entries = (("extra", HELD_UP),) if finds_held else ()
        self._agents: list[Agent] = [self._make()]
        spec = self._agents[0].spec
        self.name, self.obs_mode, self.files = spec.name, spec.obs_mode, spec.files
        self.sees_images = not spec.obs_mode.startswith("state")
        env = ENVS[inner.env_id].env
        self.horizon_steps, self.starts = env.horizon_steps, start_ranges(inner.env_id, env.robot)
        self.control: HabControllerConfig = control_configs(env.robot)[spec.control_mode]
        space = cast(spaces.Dict, setup.spaces_of(inner.env_id, spec).observation)
        self._entries = [(g, name) for g in ("agent", "extra") for name in cast(Any, space[g])]
        told = [name for group, name in self._entries if group == "agent" or name in TASK_ENTRIES]
        acts = self.control.arm in ARMS and self.control.base in BASES
        if spec.privileged or len(told) < len(self._entries) or not acts:
            raise OptionError(
                f"{reference} cannot act in a task as {skill}: it needs ground truth, observes "
                f"what a task does not tell, or acts by control_mode {spec.control_mode}."
            )
        self.sees_handles = ("extra", "handle_from_ee") in self._entries

    def goes_on(self, turn: Turn) -> bool:
        """See `SkillPolicy.goes_on`; a further attempt starts anew."""
        return False

    def decide(self, rows: Sequence[int], turns: Sequence[Turn], obs: Mapping[str, Any]) -> None:
        """See `SkillPolicy.decide`."""
        for row, turn in zip(rows, turns, strict=True):
            while row >= len(self._agents):
                self._agents.append(self._make())
            agent = self._agents[row]
            if turn.age == 0:
                assert turn.random is not None
                agent.reset(torch.ones(1, dtype=torch.bool), [int(turn.random.integers(2**31))])
            turn.age += 1
            seen: dict[str, Any] = {"agent": {}, "extra": {}}
            for group, name in (*self._entries, *self._more_entries):
                seen[group][name] = torch.from_numpy(turn.entries[group, name])[None]
            if self.sees_images:
                images = of_rows(obs, [row])
                seen |= {name: images[name] for name in ("sensor_data", "sensor_param")}
            turn.action = agent.act(seen)[0].detach().cpu().numpy().reshape(-1)
            turn.gave_up = agent.report()[0].failure is not None
