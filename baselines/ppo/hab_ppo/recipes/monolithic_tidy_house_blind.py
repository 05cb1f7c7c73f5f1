"""MonolithicRL in TidyHouse without images: as many steps as two CPU cores make (S App. H.3).

Counterpart of the blind policies of TP+SRL; action space and reward are the same as with images.
"""

from hab_ppo.recipe import RECURRENT, EnvConfig, Recipe

RECIPE = Recipe(
    name="monolithic_tidy_house_blind",
    about="TidyHouse with one policy, without images.",
    env=EnvConfig(env="HabTidyHouse-v1", control_mode="ee_base", num_episodes=500),
    preset=RECURRENT,
    total_steps=2_000_000,
    evaluation_steps=500_000,
    evaluation_episodes=16,
)
