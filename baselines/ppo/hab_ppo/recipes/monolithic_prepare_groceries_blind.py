"""MonolithicRL in PrepareGroceries without images (S App. H.3), as in TidyHouse."""

from dataclasses import replace

from hab_ppo.recipes.monolithic_tidy_house_blind import RECIPE as TIDY_HOUSE

RECIPE = replace(
    TIDY_HOUSE,
    name="monolithic_prepare_groceries_blind",
    about="PrepareGroceries with one policy, without images.",
    env=replace(TIDY_HOUSE.env, env="HabPrepareGroceries-v1"),
)
