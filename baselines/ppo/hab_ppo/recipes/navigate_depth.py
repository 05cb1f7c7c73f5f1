"""Depth Navigate, with the paper's 20 base actions and a learned stop (S App. H.2).

An expert that knows the map and the goal pose labels the states that the policy visits (DAgger):
where to stand before a table, a drawer or the fridge is learned slowly from the reward, as only the
point of the object is observed. PPO then learns to look for a goal pose that cannot be known.
Each action is executed for four steps (0.13 s), which saves images and shortens the way from an
action to its reward. Actions are drawn, as the most likely ones can turn back and forth forever.
"""

from dataclasses import replace

from hab_ppo.recipe import VISUAL, Cloning, Distillation, EnvConfig, FineTuning, Recipe

RECIPE = Recipe(
    name="navigate_depth",
    about="Navigate with the depth images of the head camera.",
    env=EnvConfig(
        env="HabNavigate-v1",
        control_mode="base_discrete",
        obs_mode="depth",
        action_repeat=4,
        num_episodes=1500,
    ),
    preset=replace(
        VISUAL,
        ppo=replace(VISUAL.ppo, discount=0.98, epochs=3, learning_rate=1.5e-4),
        rows=16,
        rollout_steps=100,
    ),
    total_steps=1_000_000,
    draws_actions=True,
    distill=Distillation(
        expert="shortest_path_action",
        rounds=8,
        round_steps=12_000,
        cloning=Cloning(epochs=5, patience=5),
        tuning=FineTuning(critic_updates=20, kl_weight=0.2, kl_steps=200_000),
    ),
)
