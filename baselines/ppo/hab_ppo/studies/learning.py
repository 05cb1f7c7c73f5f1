"""Learning curves: MonolithicRL (S Fig. 26), Navigate (Fig. 27), all skills (Fig. 28)."""

from __future__ import annotations

from dataclasses import replace

from hab_ppo.recipe import RECURRENT, Distillation, EnvConfig, Recipe
from hab_ppo.recipes.doors import (
    CLOSE_DRAWER_BLIND,
    CLOSE_FRIDGE_BLIND,
    OPEN_DRAWER_BLIND,
    OPEN_FRIDGE_BLIND,
)
from hab_ppo.recipes.navigate import NAVIGATE_DEPTH
from hab_ppo.recipes.pick import PICK_BLIND
from hab_ppo.recipes.place import PLACE_DISTILLED
from hab_ppo.studies.study import Arm, Axis, Budget, Study

TASKS = {
    "TidyHouse": ("HabTidyHouse-v1", "pick_1", False),
    "PrepareGroceries": ("HabPrepareGroceries-v1", "pick_fridge_1", False),
    "SetTable": ("HabSetTable-v1", "pick_bowl", True),
}
"""Name -> environment, stage of the first pick, whether it has a drawer to open."""

MONOLITHIC = Study(
    name="fig26",
    title="MonolithicRL: the first pick",
    question="How often does a single policy for a whole task pick the first object (S Fig. 26)?",
    protocol="Blind policies with an LSTM learn by PPO with the reward of the current skill "
    "(S H.3); counted is the stage of the first pick.",
    differs="The paper trains on depth images for 100 million steps. In SetTable the policy "
    "observes the positions of the handles, which cannot be seen without images.",
    arms=tuple(
        Arm(
            name=name,
            recipe=Recipe(
                name="monolithic",
                about="A whole task by one policy.",
                env=EnvConfig(env=env, control_mode="ee_base", handle_position=handle),
                preset=RECURRENT,
            ),
            budgets={
                "quick": Budget(
                    steps=3_200,
                    training_episodes=8,
                    evaluations=1,
                    validation_episodes=1,
                    episodes=1,
                ),
                "full": Budget(
                    steps=500_000,
                    training_episodes=500,
                    evaluations=5,
                    validation_episodes=10,
                    episodes=50,
                ),
            },
            measure=stage,
        )
        for name, (env, stage, handle) in TASKS.items()
    ),
    figure=Axis(kind="curves", training=True),
)

NAVIGATE_BUDGETS = {
    "quick": Budget(
        steps=1_600, training_episodes=24, evaluations=1, validation_episodes=4, episodes=6
    ),
    "full": Budget(steps=250_000, training_episodes=1500, evaluations=5, episodes=300),
}

STOP = Study(
    name="fig27",
    title="Navigate with and without learned stop",
    question="What does learning when to stop cost Navigate (S Fig. 27)?",
    protocol="Policies with the depth images of the head camera learn by PPO "
    "(`navigate_depth`), with the stop action of the paper or with arrival as success.",
    differs="Fewer steps; both policies are evaluated with their own rule.",
    arms=(
        Arm(name="learned stop", recipe=NAVIGATE_DEPTH, budgets=NAVIGATE_BUDGETS),
        Arm(
            name="no stop",
            recipe=replace(
                NAVIGATE_DEPTH,
                env=replace(NAVIGATE_DEPTH.env, skill_config={"learned_stop": 0.0}),
            ),
            budgets=NAVIGATE_BUDGETS,
        ),
    ),
    figure=Axis(kind="curves", training=True),
)

BLIND_QUICK = Budget(
    steps=3_200,
    labelled=(1, 1_000),
    training_episodes=24,
    evaluations=1,
    validation_episodes=4,
    episodes=6,
)
BLIND_FULL = Budget(
    steps=80_000, labelled=(2, 10_000), seeds=3, evaluations=4, validation_episodes=30, episodes=100
)
SKILLS = {
    "pick": (PICK_BLIND, replace(BLIND_FULL, steps=200_000, evaluations=5)),
    "place": (PLACE_DISTILLED, BLIND_FULL),
    "open drawer": (OPEN_DRAWER_BLIND, BLIND_FULL),
    "close drawer": (CLOSE_DRAWER_BLIND, BLIND_FULL),
    "open fridge": (OPEN_FRIDGE_BLIND, BLIND_FULL),
    "close fridge": (CLOSE_FRIDGE_BLIND, BLIND_FULL),
}


def _distilled(recipe: Recipe) -> Recipe:
    """Returns a recipe without demonstrations of a planner, which are made with a time limit."""
    if recipe.warm_start is None:
        return recipe
    return replace(recipe, warm_start=None, distill=Distillation(expert="drawer_action"))


CURVES = Study(
    name="fig28",
    title="Learning curves of the skills",
    question="How fast do the skills learn, in training and in evaluation (S Fig. 28)?",
    protocol="Blind policies learn by PPO, all but Pick after distillation of a scripted expert; "
    "those of doors and drawers observe the handle. Dashed: training episodes.",
    differs="The paper trains on depth images for 100 million steps from random weights. Navigate "
    "has a study of its own (Fig. 27).",
    arms=tuple(
        Arm(
            name=name,
            recipe=_distilled(recipe),
            budgets={"quick": BLIND_QUICK, "full": full},
        )
        for name, (recipe, full) in SKILLS.items()
    ),
    figure=Axis(kind="curves", training=True),
)
