"""Pick from demonstrations of SPA-Priv: cloning, then PPO; compare with `pick_blind`."""

from hab_ppo.recipe import EnvConfig, Recipe, WarmStart

RECIPE = Recipe(
    name="pick_cloned",
    about="Blind Pick, cloned from SPA-Priv and fine-tuned.",
    env=EnvConfig(env="HabPick-v1", control_mode="ee"),
    warm_start=WarmStart(),
)
