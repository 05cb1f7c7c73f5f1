"""What a benchmark measures: suites, scenes, environments and how often."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hab_eval.errors import OptionError
from hab_tasks.option_values import whole

WriteLine = Callable[[str], None]

Suite = Literal["sim", "depth", "reset", "objects", "processes", "memory", "plan"]

MOST_REPEATS = 1000
MOST_STEPS = 1_000_000
"""Motions for all steps are drawn before the first one."""

PICK = "HabPick-v1"
TIDY_HOUSE = "HabTidyHouse-v1"
DEFAULT_SCENES = ("v3_sc0_staging_00", "apt_0")
RESET_SCENES = (
    tuple(f"v3_sc{macro}_staging_{number}" for number in ("00", "10") for macro in range(3)),
    ("apt_0", "apt_1", "apt_2"),
)
"""Suite reset goes round each of these groups of layouts, unless layouts are given."""

BESIDE_REFERENCE = ("sim", "depth")
"""Suites whose default scenes are both of `DEFAULT_SCENES`; the others take the first one."""

DEFAULT_STEPS: dict[Suite, int] = {
    "sim": 200,
    "depth": 40,
    "reset": 0,
    "objects": 200,
    "processes": 1000,
    "memory": 50,
    "plan": 100,
}
"""Suite plan counts plans, the others steps of an environment."""


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """What is measured; see `hab-eval bench --help`."""

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
        if self.envs and self.suite != "sim":
            raise OptionError(f"suite {self.suite} has its own environment: leave --env out.")

    @property
    def step_count(self) -> int:
        """Steps of one repeat."""
        return self.steps or DEFAULT_STEPS[self.suite]

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Scenes that are measured together; all suites but reset have one scene in each group."""
        if self.suite == "reset":
            groups = (self.scenes,) if self.scenes else RESET_SCENES
            if any(len(group) < 2 for group in groups):
                raise OptionError(
                    "suite reset goes from layout to layout: give --scene twice or more."
                )
            return groups
        default = DEFAULT_SCENES if self.suite in BESIDE_REFERENCE else DEFAULT_SCENES[:1]
        return tuple((scene,) for scene in self.scenes or default)

    def envs_in(self, scene: str, every: tuple[str, ...]) -> tuple[str, ...]:
        """Returns the environments that suite sim measures in one of its scenes.

        Args:
            scene: The scene.
            every: All environments; without `envs` they are measured in the first scene.
        """
        if self.envs:
            return self.envs
        return every if (scene,) == self.groups[0] else (PICK,)
