"""Declaration of a study: what is trained, in which conditions it is evaluated, what is shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from hab_ppo.recipe import Distillation, Recipe
from hab_tasks.rendering import resolve_backend

QUICK, FULL = "quick", "full"
SCALES = (QUICK, FULL)


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Budget of the trainings and evaluations of an arm at a scale.

    Attributes:
        steps: Environment steps of PPO; 0 evaluates what distillation has reached.
        labelled: Number of rounds of distillation, and labelled steps of a round.
        seeds: Number of trainings.
        training_episodes: Number of training episodes.
        evaluations: Number of evaluations in the course of a training.
        validation_episodes: Episodes of each of them.
        episodes: Episodes of the evaluation in the test layouts.
    """

    steps: int
    labelled: tuple[int, int] = (0, 0)
    seeds: int = 1
    training_episodes: int = 2000
    evaluations: int = 10
    validation_episodes: int = 50
    episodes: int = 500


@dataclass(frozen=True, kw_only=True)
class Condition:
    """How the policies of an arm are evaluated.

    Attributes:
        name: Name in the table and in file names; "" if there is only one.
        line: Line of the figure.
        x: Place on its x axis.
        delay_steps: Delay of the actions.
        skill_config: Thresholds that replace the skill's.
    """

    name: str = ""
    line: str = ""
    x: float = 0.0
    delay_steps: int = 0
    skill_config: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Arm:
    """Policies that differ in nothing but the seed.

    Attributes:
        name: Name in the table.
        recipe: Their recipe; the budget replaces its lengths.
        budgets: Scale -> budget.
        conditions: How they are evaluated.
        measure: ``success``, or the stage of a task that counts as success.
    """

    name: str
    recipe: Recipe
    budgets: Mapping[str, Budget]
    conditions: tuple[Condition, ...] = (Condition(),)
    measure: str = "success"

    @property
    def slug(self) -> str:
        """Name of its files."""
        return slug(self.name)

    def recipe_at(self, scale: str, study: str) -> Recipe:
        """Returns the recipe with the lengths of a scale."""
        budget, recipe = self.budgets[scale], self.recipe
        rounds, round_steps = budget.labelled
        distill: Distillation | None = None
        if recipe.distill is not None and rounds:
            distill = replace(recipe.distill, rounds=rounds, round_steps=round_steps)
        return replace(
            recipe,
            name=f"{study}_{self.slug}",
            env=replace(recipe.env, num_episodes=budget.training_episodes),
            total_steps=budget.steps,
            evaluation_steps=max(1, budget.steps // budget.evaluations),
            evaluation_episodes=budget.validation_episodes,
            distill=distill,
        )


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What the figure shows.

    Attributes:
        kind: ``curves``: success over the steps of training; ``lines``: `measure` over the
            conditions; ``bars``: `measure` of each row of the table.
        label: Label of the x axis of ``lines``.
        measure: ``success``, or a score of the skill.
        minutes: Whether ``curves`` are also drawn over wall time.
        training: Whether ``curves`` also show the training episodes.
    """

    kind: str
    label: str = ""
    measure: str = "success"
    minutes: bool = False
    training: bool = False


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study of policies that are trained for it.

    Attributes:
        name: Name of the command line.
        title: Heading of its README.
        question: What it asks, one sentence.
        protocol: How policies are trained, in one or two sentences.
        differs: What differs from the paper and why.
        reading: What its result at full scale means beside the paper's; empty before there is one.
        arms: What is trained. Rows of the table are compared with the first.
        figure: The figure.
    """

    name: str
    title: str
    question: str
    protocol: str
    differs: str
    arms: tuple[Arm, ...]
    figure: Axis
    reading: str = ""

    def check(self) -> None:
        """Rejects a study that this machine cannot run.

        Raises:
            RenderingUnavailableError: It observes color, and there is no Vulkan device.
        """
        if any("rgb" in arm.recipe.env.obs_mode for arm in self.arms):
            resolve_backend("auto", wants_images=True)


def slug(name: str) -> str:
    """Returns a name as part of file names: lower-case words joined by underscores."""
    letters = (c.lower() if c.isalnum() else " " for c in name.replace("+", " and "))
    return "_".join("".join(letters).split())
