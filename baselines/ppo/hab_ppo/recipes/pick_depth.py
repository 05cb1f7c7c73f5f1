"""Depth Pick, from the arm's state and both depth cameras (S App. H.2).

Frames with images are dear, so an expert that knows all objects labels the states that the policy
visits (DAgger), with half of the start states at the fridge as for `pick_fridge`. PPO continues
with more minibatches than `VISUAL` has: with many ranks an update has many steps.
"""

from dataclasses import replace

from hab_ppo.recipe import VISUAL, Distillation, EnvConfig, FineTuning, Recipe

RECIPE = Recipe(
    name="pick_depth",
    about="Pick with the depth images of both cameras.",
    env=EnvConfig(
        env="HabPick-v1",
        trained_in="hab_ppo.fridge_starts:PickOftenFromFridge-v1",
        control_mode="ee",
        obs_mode="depth",
        num_episodes=2000,
    ),
    preset=replace(VISUAL, ppo=replace(VISUAL.ppo, minibatches=4)),
    total_steps=1_000_000,
    evaluation_episodes=100,
    distill=Distillation(
        expert="pick_action",
        tuning=FineTuning(log_std=-1.6, kl_weight=0.2, kl_steps=300_000),
    ),
)
