"""Options of every command that has an agent play episodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from hab_eval.config import EvalConfig


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """Which agent plays which episodes; a command's own options follow."""

    agent: Annotated[str, tyro.conf.arg(metavar="MODULE:FACTORY")]
    """The agent, e.g. hab_spa:spa_priv or hab_eval:random_agent."""
    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id, e.g. HabPick-v1; `hab-tasks list` shows all."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for what the command writes."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment`, which is shipped, or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the shipped objects."""
    split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Episode split, instead of the dataset's evaluation split."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the episodes and of the agent."""
    novel: Annotated[str | None, tyro.conf.arg(metavar="WHAT")] = None
    """objects or receptacles: those kept for evaluating generalisation."""
    option: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE"), tyro.conf.UseAppendAction
    ] = ()
    """An option of the agent's own, e.g. navigation=teleport; may be given again."""

    def config_of(self, episodes: int, step_timeout_s: float | None = None) -> EvalConfig:
        """Returns the configuration of a run of so many episodes.

        Args:
            episodes: Number of episodes.
            step_timeout_s: Longest time that the agent may take for a call [s]; None for any.

        Raises:
            HabError: An option of the agent is no NAME=VALUE, or a value is out of range.
        """
        # Loading the simulator takes seconds, which --help and a mistyped option should not.
        from hab_eval.config import EvalConfig, parse_options

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
            step_timeout_s=step_timeout_s,
        )
