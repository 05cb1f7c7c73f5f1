"""Suites of `hab-eval bench` and their options.

Packages register theirs in the entry-point group `GROUP`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from hab_eval.bench.reference import check_scenes
from hab_eval.bench.report import BenchRow
from hab_eval.errors import BenchError
from hab_eval.run import environments
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.option_values import whole

GROUP = "hab_eval.bench_suites"
"""Entry-point group of suites, e.g. ``rays = "hab_eval.bench.rays:SUITE"``."""

WriteLine = Callable[[str], None]

PICK = "HabPick-v1"
TIDY_HOUSE = "HabTidyHouse-v1"
FIRST_SCENE, DENSE_SCENE = "v3_sc0_staging_00", "apt_0"


@dataclass(frozen=True, kw_only=True)
class Suite:
    """A benchmark suite.

    Attributes:
        name: Value of ``--suite``.
        run: (options, write_line) -> rows.
        steps: Default number of steps (or plans) per repeat.
        groups: Default scenes, in groups that are measured together.
        is_round: Whether the scenes of ``--scene`` form one group, of at least two.
        takes_envs: Whether the suite supports ``--env``.
    """

    name: str
    run: Callable[[BenchOptions, WriteLine], list[BenchRow]]
    steps: int
    groups: tuple[tuple[str, ...], ...] = ((FIRST_SCENE,),)
    is_round: bool = False
    takes_envs: bool = False


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


def suite_names() -> list[str]:
    """Returns the names of all installed suites."""
    return sorted(entry_points(group=GROUP).names)


def find_suite(name: str) -> Suite:
    """Returns a suite.

    Raises:
        UnknownNameError: No installed package has a suite of this name.
        BenchError: The suite cannot be imported.
    """
    found = [entry for entry in entry_points(group=GROUP) if entry.name == name]
    if not found:
        raise UnknownNameError("suite", name, suite_names())
    try:
        return found[0].load()
    except (ImportError, AttributeError) as error:
        raise BenchError(f"Suite {name} ({found[0].value}) cannot be loaded: {error}.") from error


def run_suite(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Runs one suite, after checking scenes and environments."""
    check_scenes(options.scene_dataset, {scene for group in options.groups for scene in group})
    for env_id in options.envs:
        environments.check_env_id(env_id)
    return options.suite.run(options, write_line)
