"""Pick as `pick_distilled` does, then PPO with half of the start states at the fridge.

Two of the three tasks pick from the fridge, where a policy that is trained in the
benchmark's start states fails most.
"""

from dataclasses import replace

from hab_ppo.recipes.pick_distilled import RECIPE as DISTILLED

RECIPE = replace(
    DISTILLED,
    name="pick_fridge",
    about="Blind Pick, distilled, and fine-tuned with half of the start states at the fridge.",
    env=replace(
        DISTILLED.env,
        trained_in="hab_ppo.fridge_starts:PickOftenFromFridge-v1",
    ),
    total_steps=800_000,
)
