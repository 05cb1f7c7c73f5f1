"""Pick as `pick_fridge` does, among more and nearer objects.

Where objects stand close together, `pick_fridge` takes another one (`hab_ppo.crowded_starts`).
"""

from dataclasses import replace

from hab_ppo.recipes.pick_fridge import RECIPE as FRIDGE

RECIPE = replace(
    FRIDGE,
    name="pick_crowded",
    about="Blind Pick among near objects, distilled from an expert and fine-tuned.",
    env=replace(FRIDGE.env, trained_in="hab_ppo.crowded_starts:PickCrowded-v1"),
    total_steps=600_000,
)
