"""Evaluation by an executor: every worker has its own agent of one row and its own environment.

The worker plays an episode exactly as a local worker does, so the outcomes are the same.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Sequence

from hab_eval.records.config import EvalConfig
from hab_eval.records.results import FinishedEpisode
from hab_eval.run.environments import setup_of
from hab_eval.run.load_agent import load_agent
from hab_eval.run.rows import RolloutPlan, make_rows
from hab_eval.run.runner import play
from hab_tasks.agent import AgentSpec
from hab_tasks.engine.rollout import Job
from hab_tasks.errors import OptionError
from hab_tasks.io.executors import Executor, Task


def check_distributed(config: EvalConfig, spec: AgentSpec, videos: int) -> None:
    """Checks that an evaluation can be distributed.

    Raises:
        OptionError: It records videos or has a time limit, or its agent is isolated or batched.
    """
    if videos:
        raise OptionError(
            "--video needs --executor local: workers on other nodes cannot write to --out. "
            "`hab-eval film` records videos of a submission."
        )
    if config.step_timeout_s is not None:
        raise OptionError(
            "--step-timeout needs --executor local: a process of another node cannot be ended in "
            "the middle of a call."
        )
    if config.isolated:
        raise OptionError("--isolated needs --executor local: Ray's workers load the agent.")
    if spec.rows > 1:
        raise OptionError(
            f"--executor ray needs an agent of one row; {spec.name} has {spec.rows}. Its results "
            "could depend on how episodes are divided into batches; use --executor local."
        )


def run_distributed(
    plan: RolloutPlan, jobs: Sequence[Job], executor: Executor
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs and yields results as they finish.

    Raises:
        RunStoppedError: An episode raised or its worker died repeatedly.
        HabError: The environment or the agent cannot be created.
    """
    task = Task(start=_start_player, arguments=(plan,), name=_name)
    with contextlib.closing(executor.run(task, jobs)) as results:
        for _, finished in results:
            yield finished


def _start_player(plan: RolloutPlan) -> Callable[[Job], FinishedEpisode]:
    agent = load_agent(plan.config.agent, setup_of(plan.config, plan.device))
    rows = make_rows(plan, agent.spec, 1)

    def play_one(job: Job) -> FinishedEpisode:
        (finished,) = play(agent, rows, iter([job]))
        return finished

    return play_one


def _name(job: Job) -> str:
    return f"Episode {job[1].id!r}"
