"""Place as in `place_distilled`, with half of the goals in the fridge.

Two of the three tasks place into the fridge, where a policy that is trained in the benchmark's
start states fails most. It is meant to continue from `place_distilled`
(`--weights place_distilled`), and so explores less in the beginning.
"""

from dataclasses import replace

from hab_ppo.recipe import FAST
from hab_ppo.recipes.place_distilled import RECIPE as DISTILLED

RECIPE = replace(
    DISTILLED,
    name="place_fridge",
    about="Blind Place, trained with half of the goals in the fridge.",
    env=replace(DISTILLED.env, trained_in="hab_ppo.fridge_starts:PlaceOftenInFridge-v1"),
    preset=replace(FAST, network=replace(FAST.network, log_std=-1.2)),
    total_steps=500_000,
    distill=None,
)
