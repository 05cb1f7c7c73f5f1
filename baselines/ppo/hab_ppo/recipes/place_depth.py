"""Depth Place, from the arm's state and both depth cameras (S App. H.2).

Frames with images are dear, so an expert that knows all objects labels the states that the policy
visits (DAgger), with half of the goals in the fridge as for `place_fridge`.
"""

from hab_ppo.recipe import VISUAL, Cloning, Distillation, EnvConfig, FineTuning, Recipe

RECIPE = Recipe(
    name="place_depth",
    about="Place with the depth images of both cameras.",
    env=EnvConfig(
        env="HabPlace-v1",
        trained_in="hab_ppo.fridge_starts:PlaceOftenInFridge-v1",
        control_mode="ee",
        obs_mode="depth",
        num_episodes=2000,
    ),
    preset=VISUAL,
    total_steps=100_000,
    distill=Distillation(
        expert="place_action",
        rounds=9,
        cloning=Cloning(epochs=10, patience=10, bfloat16=True),
        tuning=FineTuning(log_std=-1.6, kl_weight=0.2, kl_steps=300_000),
    ),
)
