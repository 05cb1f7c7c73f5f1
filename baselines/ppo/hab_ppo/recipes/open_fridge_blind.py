"""Open the fridge with arm and base, without images (S App. H.2).

The reward pays for little but the finished skill, so random actions never find it. An expert that
knows the door's axis labels the states that the policy visits (DAgger) before PPO. The handle's
position is no part of the paper's observation; without it and without images, the handle cannot be
found. The policy does not observe the borders of its region either: half of the start states are in
a corner of it, so that a way is worth learning that stays inside from there too.
"""

from hab_ppo.recipe import RECURRENT, Distillation, EnvConfig, FineTuning, Recipe

RECIPE = Recipe(
    name="open_fridge_blind",
    about="Open the fridge from the state of the arm and the position of the handle.",
    env=EnvConfig(
        env="HabOpenFridge-v1",
        trained_in="hab_ppo.fridge_starts:OpenFridgeFromCorners-v1",
        control_mode="ee_base",
        handle_position=True,
        num_episodes=2000,
    ),
    preset=RECURRENT,
    total_steps=400_000,
    evaluation_episodes=100,
    distill=Distillation(
        expert="door_action",
        tuning=FineTuning(log_std=-1.4, kl_weight=0.1, kl_steps=200_000),
    ),
)
