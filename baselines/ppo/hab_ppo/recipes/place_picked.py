"""Place as `place_fridge` does, with objects as a pick leaves them in the hand.

In a task, the object is not upright and not at the hand, where policies trained in the benchmark's
start states push it against tables or let a can roll away (`hab_ppo.picked_objects`).
"""

from dataclasses import replace

from hab_ppo.recipes.place_fridge import RECIPE as FRIDGE

RECIPE = replace(
    FRIDGE,
    name="place_picked",
    about="Blind Place of objects as a pick leaves them, distilled from an expert and fine-tuned.",
    env=replace(FRIDGE.env, trained_in="hab_ppo.picked_objects:PlacePicked-v1"),
    total_steps=600_000,
)
