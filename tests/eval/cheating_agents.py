"""Agents that win by reaching into the evaluator or the environment, or fail if they cannot."""

from __future__ import annotations

import gc
import sys
from dataclasses import replace

import stub_hab
import torch
from hab_eval.run import isolation, runner

from hab_tasks.agent import AgentSetup, of_rows


def patching(setup: AgentSetup) -> stub_hab.StubAgent:
    """Lets the evaluator write success."""
    inner = runner._finished

    def finish(*arguments: object) -> object:
        finished = inner(*arguments)
        won = replace(finished.episode, success=True, failure=None)
        return replace(finished, episode=won)

    runner._finished = finish
    return stub_hab.StubAgent()


def finding(setup: AgentSetup) -> stub_hab.StubAgent:
    """Finds the environment and makes its episode an easy one."""
    agent = stub_hab.StubAgent()

    def act(obs: object) -> torch.Tensor:
        for env in gc.get_objects():
            if type(env).__name__ == "StubEnv" and env._episode is not None:
                env._episode = replace(env._episode, seed=0)
        return torch.full((1, 2), 0.5)

    agent.act = act
    return agent


def reading(setup: AgentSetup) -> stub_hab.StubAgent:
    """Tells the run's seed in its trace, from the command line."""
    agent = stub_hab.StubAgent()
    inner = agent.report
    agent.report = lambda: [replace(one, trace=({"argv": sys.argv[1:]},)) for one in inner()]
    return agent


def sending(setup: AgentSetup) -> stub_hab.StubAgent:
    agent = stub_hab.StubAgent()

    def act(obs: object) -> torch.Tensor:
        (own,) = (one for one in gc.get_objects() if isinstance(one, isolation.Connection))
        own.send(print)  # would run code if it were unpickled
        return torch.full((1, 2), 0.5)

    agent.act = act
    return agent


def keeping(setup: AgentSetup) -> stub_hab.StubAgent:
    """Keeps a part of an observation, and reads it when the simulation has gone on."""
    agent, kept = stub_hab.StubAgent(privileged=True), []

    def act(obs: object) -> torch.Tensor:
        kept.append(of_rows(obs, [0]))
        if len(kept) > 1:
            kept[0]["privileged"]
        return torch.full((1, 2), 0.5)

    agent.act = act
    return agent
