"""Options of a benchmark: suite, scenes, environments and repeats."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hab_eval.bench.suite import PICK, Suite
from hab_tasks.errors import OptionError
from hab_tasks.option_values import whole

MOST_REPEATS = 1000
MOST_STEPS = 1_000_000
"""The motions of all steps are sampled in advance."""


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """Options of `hab-eval bench`; see its ``--help``."""

    suite: Suite
    scene_dataset: Path
    objects: Path | None = None
    scenes: tuple[str, ...] = ()
    envs: tuple[str, ...] = ()
    repeats: int = 5
    steps: int | None = None

    def __post_init__(self) -> None:
        whole("repeats", self.repeats, 1, MOST_REPEATS)
        if self.steps is not None:
            whole("steps", self.steps, 1, MOST_STEPS)
        if self.envs and not self.suite.takes_envs:
            raise OptionError(f"suite {self.suite.name} does not support --env.")

    @property
    def step_count(self) -> int:
        """Steps per repeat."""
        return self.steps or self.suite.steps

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Groups of scenes that are measured together."""
        if not self.scenes:
            return self.suite.groups
        if not self.suite.is_round:
            return tuple((scene,) for scene in self.scenes)
        if len(self.scenes) < 2:
            raise OptionError(
                f"suite {self.suite.name} resets between layouts: give --scene at least twice."
            )
        return (self.scenes,)

    def envs_in(self, scene: str, every: tuple[str, ...]) -> tuple[str, ...]:
        """Returns the environments that suite sim measures in a scene.

        Args:
            scene: The scene.
            every: All environments; the default in the first scene.
        """
        if self.envs:
            return self.envs
        return every if (scene,) == self.groups[0] else (PICK,)
