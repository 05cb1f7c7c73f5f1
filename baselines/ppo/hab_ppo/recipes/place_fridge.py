"""Place as `place_distilled` does, then PPO with half of the start states at the fridge.

Two of the three tasks place into the fridge, where a policy that is trained in the
benchmark's start states fails most.
"""

from dataclasses import replace

from hab_ppo.recipes.place_distilled import RECIPE as DISTILLED

RECIPE = replace(
    DISTILLED,
    name="place_fridge",
    about="Blind Place, distilled, and fine-tuned with half of the start states at the fridge.",
    env=replace(
        DISTILLED.env,
        trained_in="hab_ppo.fridge_starts:PlaceOftenInFridge-v1",
    ),
    total_steps=800_000,
)
