"""Depth Close fridge, from the arm's state and both depth cameras (S App. H.2).

Frames with images are dear, so an expert labels the states that the policy visits (DAgger). It
knows the handle, which this policy finds in the images. The door is open up to its limit, as in a
task after Open fridge.
"""

from hab_ppo.recipe import VISUAL, Cloning, Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="close_fridge_depth",
    about="Close the fridge with the depth images of both cameras.",
    env=EnvConfig(
        env="HabCloseFridge-v1",
        trained_in="hab_ppo.fridge_starts:CloseWideOpenFridge-v1",
        control_mode="ee_base",
        obs_mode="depth",
        num_episodes=1000,
    ),
    preset=VISUAL,
    total_steps=100_000,
    distill=Distillation(
        expert="door_action",
        rounds=6,
        cloning=Cloning(epochs=10, patience=10, bfloat16=True),
    ),
)
