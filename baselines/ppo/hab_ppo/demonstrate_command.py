"""The command `hab-ppo demonstrate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_ppo.config_json import changed
from hab_ppo.limits import MOST_EPISODES, MOST_RANKS
from hab_ppo.progress import say
from hab_ppo.recipes import find_recipe
from hab_tasks.console import Command
from hab_tasks.errors import OptionError
from hab_tasks.files import check_file
from hab_tasks.option_values import LARGEST_SEED, whole

HELP = """Makes demonstrations for a recipe: an agent's solved episodes, retimed and replayed.

Example:
  hab-ppo demonstrate close_drawer_blind --workers 2 --out demonstrations.safetensors
  hab-ppo train close_drawer_blind --demonstrations demonstrations.safetensors --out runs/close"""


@dataclass(frozen=True, kw_only=True)
class DemonstrateCommand(Command):
    """Options of `hab-ppo demonstrate`."""

    help: ClassVar[str] = HELP

    recipe: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME")]
    """A recipe of `hab-ppo list`, or `module:NAME`; its training episodes are played."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output file, .safetensors."""
    agent: Annotated[str, tyro.conf.arg(metavar="MODULE:FACTORY")] = "hab_spa:spa_priv"
    """The agent that demonstrates."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 300
    """Number of demonstrations."""
    noise: Annotated[float, tyro.conf.arg(metavar="SHARE")] = 0.5
    """Standard deviation of the noise on the executed actions, as a share of the largest."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 2
    """Number of processes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the noise."""
    episodes: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of training episodes, instead of the recipe's."""
    force: bool = False
    """Replace FILE."""
    verbose: bool = False
    """Print the traceback of an error in an episode."""

    def run(self) -> int:
        """Makes the demonstrations."""
        whole("--count", self.count, 1, MOST_EPISODES)
        whole("--workers", self.workers, 1, MOST_RANKS)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        if self.episodes is not None:
            whole("--episodes", self.episodes, 1, MOST_EPISODES)
        if not 0 <= self.noise <= 1:
            raise OptionError.of_value("--noise", self.noise, "from 0 to 1")
        recipe = find_recipe(self.recipe)
        recipe = changed(recipe, env=changed(recipe.env, num_episodes=self.episodes))
        check_file(self.out, force=self.force)
        from hab_ppo.warm_start import DemonstrationPlan, write_demonstrations  # the simulator

        plan = DemonstrationPlan(
            recipe=recipe,
            agent=self.agent,
            count=self.count,
            noise=self.noise,
            seed=self.seed,
            workers=self.workers,
        )
        write_demonstrations(self.out, plan, say)
        return 0
