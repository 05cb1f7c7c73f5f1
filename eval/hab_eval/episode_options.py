"""Options shared by the commands that run an agent on episodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from hab_eval.config import EvalConfig


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

    def config_of(
        self, episodes: int, step_timeout_s: float | None = None, *, isolated: bool = False
    ) -> EvalConfig:
        """Returns the evaluation's configuration.

        Args:
            episodes: Number of episodes.
            step_timeout_s: Time limit for one call of the agent [s]; None for no limit.
            isolated: Whether the agent runs in processes of its own.

        Raises:
            HabError: An agent option is not NAME=VALUE, or a value is out of range.
        """
        # Imported here: loading the simulator takes seconds, and --help does not need it.
        from hab_eval.config import EvalConfig, parse_numbers, parse_options

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
            step_timeout_s=step_timeout_s,
            isolated=isolated,
        )
