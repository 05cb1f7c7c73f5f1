"""Pick as in `pick_blind`, with half of the start states at the fridge.

Two of the three tasks pick from the fridge, where a policy that is trained in the benchmark's start
states fails most. It explores less than `pick_blind` in the beginning, as it is meant to continue
from its weights (`--weights pick_blind`).
"""

from dataclasses import replace

from hab_ppo.recipe import FAST
from hab_ppo.recipes.pick_blind import RECIPE as BLIND

RECIPE = replace(
    BLIND,
    name="pick_fridge",
    about="Blind Pick, trained with half of the start states at the fridge.",
    env=replace(BLIND.env, trained_in="hab_ppo.fridge_starts:PickOftenFromFridge-v1"),
    preset=replace(FAST, network=replace(FAST.network, log_std=-1.2)),
    total_steps=1_000_000,
)
