"""MonolithicRL in PrepareGroceries: as in TidyHouse (S App. H.3)."""

from dataclasses import replace

from hab_ppo.recipes.monolithic_tidy_house import RECIPE as TIDY_HOUSE

RECIPE = replace(
    TIDY_HOUSE,
    name="monolithic_prepare_groceries",
    about="PrepareGroceries with one policy, from depth images.",
    env=replace(TIDY_HOUSE.env, env="HabPrepareGroceries-v1"),
)
