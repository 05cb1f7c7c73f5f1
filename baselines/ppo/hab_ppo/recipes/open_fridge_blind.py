"""Open the fridge with arm and base, without images (S App. H.2).

The reward pays for little but the finished skill, so random actions never find it. An expert that
knows the door's axis labels the states that the policy visits (DAgger) before PPO. The handle's
position is no part of the paper's observation; without it and without images, the handle cannot be
found.
"""

from hab_ppo.recipe import RECURRENT, Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="open_fridge_blind",
    about="Open the fridge from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabOpenFridge-v1", control_mode="ee_base", handle_position=True),
    preset=RECURRENT,
    total_steps=200_000,
    distill=Distillation(expert="door_action"),
)
