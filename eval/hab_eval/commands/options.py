"""Options of the commands that play episodes and of benchmarks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_eval.records.config import EvalConfig, parse_numbers, parse_options
from hab_tasks.io.console import Command
from hab_tasks.io.executors import ExecutorChoice

RUN_HELP = """Evaluates an agent on a fixed set of episodes and writes run.json.

Example:
  hab-eval run --agent hab_eval:random_agent --env HabPick-v1 --episodes 10 --out runs/random

After an interruption, the same command with --resume continues the run.

On a Ray cluster (pip install 'ray>=2.30'), from one of its nodes:
  hab-eval run --agent hab_eval:random_agent --env HabPick-v1 --episodes 1000 --workers 64 \\
    --executor ray --address auto --out runs/random

Episodes of a node that dies are played again on the others."""

SWEEP_HELP = """Measures how robust an agent is, one axis at a time.

Example:
  hab-eval sweep --agent hab_ppo:pick_depth --env HabPick-v1 --axes camera,noise,delay \\
    --split test --episodes 100 --workers 2 --out runs/sweep

The agent plays the committed episodes, and the same ones at each level of each axis. The change in
success is paired by episode, with Newcombe's 95 % interval and McNemar's exact test. Episodes of
another seed show how far chance alone changes it.

Axes:
  camera    head and arm camera 1 cm and 1 deg, or 3 cm and 3 deg, off the pose that is told
  noise     sensor noise of the default strength, or four times as strong
  delay     actions 1 or 3 steps late
  friction  friction coefficients of objects x 0.3 or x 3
  lighting  brightness of all lamps x 0.4 or x 2, for agents that see colour
  clutter   5 or 10 further objects where objects start and go
  layout    the layouts of --layouts, not paired

After an interruption, the same command with --resume continues the sweep."""

SERVE_HELP = """Serves an agent as a policy server (pip install 'hab-eval[remote]').

Example:
  hab-eval serve --agent hab_ppo:pick_blind --env HabPick-v1 --protocol openpi --port 8000
  hab-eval run --agent hab_eval:remote --env HabPick-v1 --option address=ws://127.0.0.1:8000 \\
    --option protocol=openpi --out runs/remote"""

BENCH_HELP = """Benchmarks speed and memory against ManiSkill's own scene environment.

Example:
  hab-eval bench --suite sim --scene-dataset ~/data/replica_cad --json bench_sim.json

Requires the real ReplicaCAD. Both environments run in the same scenes, alternating.

Suites:
  sim          steps/s with state observations, compared with ManiSkill
  depth        steps/s with two depth cameras, compared with ManiSkill
  reset        reset time within and between layouts, compared with ManiSkill
  vector       steps/s of 16 rows of the vector environment, compared with AsyncVectorEnv
  rays         depth images computed on the CPU, compared with a software renderer
  episodes     time per generated episode
  plan         arm planning time of the SPA baseline, which must be installed
  train        training steps of hab-ppo, which must be installed
  regressions  settled claims: 10 to 100 objects, two processes, memory of a process"""


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """Agent and episodes; subclasses add the options of a command."""

    agent: Annotated[str, tyro.conf.arg(metavar="MODULE:FACTORY")]
    """Factory of the agent, e.g. hab_spa:spa_priv or hab_eval:random_agent."""
    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id, e.g. HabPick-v1; `hab-tasks list` prints all."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment` (shipped) or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """Folder of the YCB dataset; the shipped objects if not given."""
    split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Episode split; the evaluation split of the dataset if not given."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the episodes and of the agent."""
    novel: Annotated[str | None, tyro.conf.arg(metavar="WHAT")] = None
    """Evaluate generalization to held-out `objects` or `receptacles`."""
    option: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE"), tyro.conf.UseAppendAction
    ] = ()
    """An agent option, e.g. navigation=learned; can be repeated."""

    skill_config: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME=NUMBER"), tyro.conf.UseAppendAction
    ] = ()
    """A reward weight or threshold of the skill, e.g. force_limit_n=2500; can be repeated."""
    env_option: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE"), tyro.conf.UseAppendAction
    ] = ()
    """An option of the environment, e.g. action_delay_steps=2, sensor_noise.joint_rad=0.01 or
    perturbation.clutter=5; can be repeated."""

    def config_of(
        self,
        episodes: int,
        step_timeout_s: float | None = None,
        *,
        isolated: bool = False,
        instructions: str = "fixed",
    ) -> EvalConfig:
        """Returns the evaluation's configuration.

        Args:
            episodes: Number of episodes.
            step_timeout_s: Time limit for one call of the agent [s]; None for no limit.
            isolated: Whether the agent runs in processes of its own.
            instructions: Wording of the instructions, ``fixed`` or ``varied``.

        Raises:
            HabError: An option is not NAME=VALUE, or a value is out of range.
        """
        return EvalConfig(
            agent=self.agent,
            env=self.env,
            scene_dataset=self.scene_dataset,
            objects=self.objects,
            split=self.split,
            episodes=episodes,
            seed=self.seed,
            novel=self.novel,
            options=parse_options(self.option),
            skill_config=parse_numbers(self.skill_config),
            env_options=parse_options(self.env_option, "--env-option"),
            step_timeout_s=step_timeout_s,
            isolated=isolated,
            instructions=instructions,
        )


@dataclass(frozen=True, kw_only=True)
class RunCommand(EpisodeOptions, ExecutorChoice, Command):
    """Options of `hab-eval run`."""

    help: ClassVar[str] = RUN_HELP
    work: ClassVar[str] = "hab_eval.commands.run:run"

    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id, e.g. HabPick-v1; `hab-tasks list` prints all. `tasks` evaluates in all tasks,
    each in a folder of DIR."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder for run.json, episodes.jsonl, config.json and videos."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 50
    """Number of episodes."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of worker processes; does not change results. A batched agent runs once, in the main
    process; the workers then only step its environments."""
    step_timeout: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None
    """Time limit for one call of the agent's act, reset or report; no limit if not given. An
    episode that exceeds it fails (`agent timeout`), its process is replaced, and the run
    continues."""
    isolated: bool = False
    """Run the agent in a process without environment, which knows neither the seed nor the
    episodes; the leaderboard says so. Outcomes stay the same."""
    instructions: Annotated[str, tyro.conf.arg(metavar="HOW")] = "fixed"
    """Wording of the instructions: `fixed`, or `varied` with synonyms drawn per episode."""
    device: Annotated[str, tyro.conf.arg(metavar="NAME")] = "cpu"
    """Device of the agent's networks, e.g. cuda."""
    video: Annotated[int, tyro.conf.arg(metavar="K")] = 0
    """Record videos of the first K episodes; needs a Vulkan device (software is enough)."""
    resume: bool = False
    """Continue the run in --out."""
    force: bool = False
    """Replace the run in --out."""
    verbose: bool = False
    """Print a line for each episode, even with a progress bar, and the traceback of an error in an
    episode."""

    def config_of_run(self) -> EvalConfig:
        """Returns the evaluation's configuration; see `config_of`."""
        return self.config_of(
            self.episodes,
            self.step_timeout,
            isolated=self.isolated,
            instructions=self.instructions,
        )

    def advice(self) -> str:
        """Returns how to continue an interrupted run."""
        return f"Finished episodes are kept in {self.out}; continue with --resume."


@dataclass(frozen=True, kw_only=True)
class SweepCommand(RunCommand):
    """Options of `hab-eval sweep`."""

    help: ClassVar[str] = SWEEP_HELP
    work: ClassVar[str] = "hab_eval.commands.sweep:sweep"

    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id, e.g. HabPick-v1; `hab-tasks list` prints all."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder: a run for each level, and sweep.png."""
    axes: Annotated[str, tyro.conf.arg(metavar="NAMES")] = "camera,noise,delay,friction,clutter"
    """Axes, joined by commas: camera, noise, delay, friction, lighting, clutter, layout."""
    layouts: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """Dataset of other layouts, for the axis layout."""


@dataclass(frozen=True, kw_only=True)
class ServeCommand(Command):
    """Options of `hab-eval serve`."""

    help: ClassVar[str] = SERVE_HELP
    work: ClassVar[str] = "hab_eval.commands.serve:run"

    agent: Annotated[str, tyro.conf.arg(metavar="MODULE:FACTORY")]
    """Factory of the agent, e.g. hab_ppo:pick_blind."""
    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id, e.g. HabPick-v1; `hab-tasks list` prints all."""
    protocol: Annotated[str, tyro.conf.arg(metavar="NAME")]
    """openpi or vla-eval."""
    port: Annotated[int, tyro.conf.arg(metavar="N")] = 8000
    """Port; 0 picks a free one."""
    host: Annotated[str, tyro.conf.arg(metavar="ADDRESS")] = "127.0.0.1"
    """Interface to listen on; any but the loopback interface needs a token in HAB_REMOTE_TOKEN."""
    option: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE"), tyro.conf.UseAppendAction
    ] = ()
    """An agent option; can be repeated."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the run, as for `hab-eval run`."""
    device: Annotated[str, tyro.conf.arg(metavar="NAME")] = "cpu"
    """Device of the agent's networks, e.g. cuda."""


@dataclass(frozen=True, kw_only=True)
class BenchCommand(Command):
    """Options of `hab-eval bench`."""

    help: ClassVar[str] = BENCH_HELP
    work: ClassVar[str] = "hab_eval.commands.bench:run_bench"

    suite: Annotated[str, tyro.conf.arg(metavar="NAME")]
    """Benchmark suite, see above."""
    json: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output file."""
    scene_dataset: Annotated[Path, tyro.conf.arg(metavar="PATH")]
    """Folder of the real ReplicaCAD dataset; it is not modified."""
    objects: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = None
    """Folder of the YCB dataset; the shipped objects if not given."""
    scene: Annotated[tuple[str, ...], tyro.conf.arg(metavar="ID"), tyro.conf.UseAppendAction] = ()
    """A scene; can be repeated. The scenes of the suite if not given."""
    env: Annotated[tuple[str, ...], tyro.conf.arg(metavar="ID"), tyro.conf.UseAppendAction] = ()
    """Suite sim: an environment; can be repeated. All environments in the first scene and
    HabPick-v1 in the others if not given."""
    repeats: Annotated[int, tyro.conf.arg(metavar="N")] = 5
    """Number of repeats, alternating with the reference; medians are reported."""
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Steps per repeat (suite plan: plans per repeat); the suite's number if not given."""
    force: bool = False
    """Overwrite FILE."""
