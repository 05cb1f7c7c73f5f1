"""Depth Navigate, with the paper's 20 base actions and a learned stop (S App. H.2).

Learned by PPO alone. The expert that drives to the goal pose is hard to imitate: the policy does
not observe this pose, only the point that another skill starts from it.
"""

from dataclasses import replace

from hab_ppo.recipe import VISUAL, EnvConfig, Recipe

RECIPE = Recipe(
    name="navigate_depth",
    about="Navigate with the depth images of the head camera.",
    env=EnvConfig(
        env="HabNavigate-v1", control_mode="base_discrete", obs_mode="depth", num_episodes=1500
    ),
    preset=replace(VISUAL, ppo=replace(VISUAL.ppo, discount=0.995), rows=16),
    total_steps=2_000_000,
    evaluation_steps=200_000,
)
