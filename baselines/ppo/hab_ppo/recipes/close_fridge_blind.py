"""Close the fridge with arm and base, without images (S App. H.2).

The reward pays for little but the finished skill, so random actions never find it. An expert that
knows the door's axis labels the states that the policy visits (DAgger) before PPO. The handle's
position is no part of the paper's observation; it says how far the door is open.
"""

from hab_ppo.recipe import RECURRENT, Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="close_fridge_blind",
    about="Close the fridge from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabCloseFridge-v1", control_mode="ee_base", handle_position=True),
    preset=RECURRENT,
    total_steps=200_000,
    distill=Distillation(expert="door_action"),
)
