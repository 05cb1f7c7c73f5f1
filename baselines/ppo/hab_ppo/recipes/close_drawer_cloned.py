"""Close a drawer from demonstrations of SPA-Priv: cloning, then PPO; see `close_drawer_blind`."""

from hab_ppo.recipe import EnvConfig, Recipe, WarmStart

RECIPE = Recipe(
    name="close_drawer_cloned",
    about="Close a drawer, cloned from SPA-Priv and fine-tuned.",
    env=EnvConfig(env="HabCloseDrawer-v1", control_mode="ee", handle_position=True),
    warm_start=WarmStart(),
)
