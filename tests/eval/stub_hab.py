"""A stub environment with three outcomes, its episodes and agents, without a simulator.

The seed determines the outcome of an episode: seed % 3 == 0 succeeds at step 3, 1 fails by force at
step 2, 2 reaches the horizon at step 5.
"""

from __future__ import annotations

import functools
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

import torch
from hab_eval.records.config import EvalConfig
from hab_eval.run import environments
from hab_eval.run.environments import agent_seed

from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec, check_options
from hab_tasks.errors import HabError, UnknownNameError

HORIZON_STEPS = 5
ENV_ID = "HabStub-v1"


@dataclass(frozen=True, kw_only=True)
class StubEpisode:
    id: str
    scene_id: str
    seed: int


class StubEnv:
    def __init__(self, *, render: bool) -> None:
        if "STUB_REFUSE" in os.environ:
            raise HabError(os.environ["STUB_REFUSE"])
        self.unwrapped = self
        self._render = render
        self._episode: StubEpisode | None = None
        self._steps = 0
        self.looks = 0

    def reset(self, *, seed, options):
        assert options["reconfigure"]
        self._episode = options["episode"]
        assert seed == self._episode.seed
        self._steps = 0
        return {"steps": torch.zeros(1)}, {}

    def step(self, action):
        time.sleep(float(os.environ.get("STUB_STEP_S", "0")))
        if os.environ.get("STUB_KILL_EPISODE") == self._episode.id:
            os.kill(os.getpid(), signal.SIGKILL)
        self._steps += 1
        kind = self._episode.seed % 3
        success = kind == 0 and self._steps == 3
        force = kind == 1 and self._steps == 2
        truncated = self._steps == HORIZON_STEPS
        info = {
            "success": torch.tensor([success]),
            "fail": torch.tensor([force]),
            "failures": {"force": torch.tensor([force]), "dropped_object": torch.tensor([False])},
            "stages": {"reached": torch.tensor([kind != 1])},
        }
        reward = action.mean(dim=1)
        done = torch.tensor([success or force])
        return {"steps": torch.ones(1)}, reward, done, torch.tensor([truncated]), info

    def privileged(self):
        return [f"true state of {self._episode.id}"]

    def look(self):
        self.looks += 1
        return {"sensor_param": {}, "sensor_data": {"head": self._steps}}

    def render(self):
        assert self._render
        return torch.full((1, 64, 64, 3), 40 * self._steps, dtype=torch.uint8)

    def render_views(self):
        assert self._render
        shade = 40 * self._steps
        return {name: torch.full((1, 32, 32, 3), shade, dtype=torch.uint8) for name in "ab"}

    def hand_and_force(self):
        return "holds no object, force 0 N"

    def close(self) -> None: ...


@functools.cache
def _seed_of_agents_seed() -> dict[int, int]:
    return {agent_seed(seed): seed for seed in range(20_000)}


def episode_seeds(seeds) -> list[int]:
    """The episodes' seeds, from those that an agent gets."""
    return [_seed_of_agents_seed()[seed] for seed in seeds]


class StubAgent:
    """Repeats a constant action; `act` may be replaced."""

    def __init__(self, *, privileged: bool = False, failure: str | None = None) -> None:
        self.spec = AgentSpec(name="Stub", control_mode="ee", privileged=privileged)
        self.failure = failure
        self.seen: list[dict] = []
        self.truths: list[str] = []
        self.seeds: list[int] = []

    def reset(self, mask, seeds) -> None:
        assert mask.tolist() == [True]
        self.seeds += episode_seeds(seeds)

    def act(self, obs):
        self.seen.append(obs)
        if self.spec.privileged:
            self.truths += obs["privileged"]
        return torch.full((1, 2), 0.5)

    def report(self):
        return [AgentReport(failure=self.failure, timings_s={"plan": 0.25})]


def constant(setup: AgentSetup) -> StubAgent:
    return StubAgent()


def optional(setup: AgentSetup) -> StubAgent:
    """Knows two options, acts by the first, and asks for more than the usual observations."""
    check_options(setup, {"mode": ("still", "lively"), "file": None})
    agent = StubAgent()
    agent.spec = replace(agent.spec, handle_position=True, target_frame="ee")
    if setup.options.get("mode") == "still":
        agent.act = lambda obs: torch.zeros(1, 2)
    return agent


def telling(setup: AgentSetup) -> StubAgent:
    """Tells what it saw and did, except of the second episode."""
    agent = StubAgent()

    def report():
        if agent.seeds[-1] % 1000 == 1:
            return [AgentReport()]
        trace = ({"seed": agent.seeds[-1]}, {"steps": len(agent.seen)})
        return [AgentReport(doing=f"step {len(agent.seen)}", trace=trace)]

    agent.report = report
    return agent


def raising(setup: AgentSetup) -> StubAgent:
    """Fails in the third episode."""
    agent = StubAgent()

    def act(obs):
        if len(agent.seeds) == 3:
            raise ZeroDivisionError("three is too many")
        return torch.zeros(1, 2)

    agent.act = act
    return agent


class ManyAgent:
    """Acts on three rows, and tells how often it acted on each since its reset."""

    def __init__(self) -> None:
        self.spec = AgentSpec(name="Many", control_mode="ee", rows=3)
        self.seeds: list[int] = []
        self.acts: list[int] = []

    def reset(self, mask, seeds) -> None:
        if not self.acts:
            assert mask.all()
            self.acts = [0] * len(mask)
        self.seeds = episode_seeds(seeds)
        self.acts = [0 if new else old for new, old in zip(mask.tolist(), self.acts, strict=True)]

    def act(self, obs):
        assert obs["steps"].shape == (len(self.acts),)
        self.acts = [count + 1 for count in self.acts]
        return torch.full((len(self.acts), 2), 0.5)

    def report(self):
        rows = zip(self.seeds, self.acts, strict=True)
        told = [{"seed": seed, "acts": acts, "rows": len(self.acts)} for seed, acts in rows]
        return [AgentReport(doing="act", trace=(one,)) for one in told]


def many(setup: AgentSetup) -> ManyAgent:
    return ManyAgent()


def load_episode_set(config: EvalConfig, progress, workers) -> SimpleNamespace:
    if config.scene_dataset != "apartment":
        raise UnknownNameError("scene dataset", config.scene_dataset, ["apartment"])
    if config.split not in (None, "val", "train"):
        raise UnknownNameError("split", config.split, ["train", "val"])
    episodes = tuple(
        StubEpisode(id=f"stub/{i:03d}", scene_id=f"scene_{i % 2}", seed=1000 * config.seed + i)
        for i in range(config.episodes)
    )
    if progress:
        progress(config.episodes, config.episodes)
    split = config.split or "val"
    return SimpleNamespace(split=split, scene_dataset=config.scene_dataset, episodes=episodes)


def check_env_id(env_id: str) -> None:
    if env_id not in (ENV_ID, "HabOther-v1"):
        raise UnknownNameError("environment", env_id, [ENV_ID, "HabOther-v1"])


def install() -> Callable[[], None]:
    """Puts the stub in the place of `hab_tasks`; returns how to undo it."""
    replaced = {
        "check_env_id": check_env_id,
        "load_episode_set": load_episode_set,
        "make_env": lambda config, spec, *, split, render: StubEnv(render=render),
        "instruction_of": lambda env_id, episode: f"Be like {episode.id}.",
        "action_size": lambda env_id, control_mode, robot: 2,
        "continuous_control": lambda env_id: "ee",
        "gripper_entry": lambda env_id, control_mode, robot: 1,
    }
    before = {name: getattr(environments, name) for name in replaced}
    vars(environments).update(replaced)
    return lambda: vars(environments).update(before)
