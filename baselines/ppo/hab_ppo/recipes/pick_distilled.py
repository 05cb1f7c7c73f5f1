"""Pick from an expert's labels (DAgger), then PPO; compare with `pick_blind` and `pick_cloned`.

The expert knows all objects, and the way into the fridge, which PPO alone finds with some seeds
only.
"""

from hab_ppo.recipe import Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="pick_distilled",
    about="Blind Pick, distilled from an expert and fine-tuned.",
    env=EnvConfig(env="HabPick-v1", control_mode="ee", num_episodes=2000),
    total_steps=500_000,
    distill=Distillation(expert="pick_action"),
)
