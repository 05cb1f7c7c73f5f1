"""Place from an expert's labels (DAgger), then PPO; compare with `place_blind`.

The expert brings the hand all the way to rest, where `place_blind` slows down as soon as its
episodes end; so this policy also finishes from the states in which another skill hands over.
"""

from hab_ppo.recipe import Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="place_distilled",
    about="Blind Place, distilled from an expert and fine-tuned.",
    env=EnvConfig(env="HabPlace-v1", control_mode="ee", num_episodes=2000),
    total_steps=100_000,
    distill=Distillation(expert="place_action", rounds=8),
)
