"""Depth Pick: the two depth cameras beside what blind Pick sees (S Table 2, "Depth").

Frames with images are dear, so `pick_blind` teaches it first: ``--teacher runs/pick_blind``.
"""

from hab_ppo.recipe import (
    Distillation,
    EnvConfig,
    NetworkConfig,
    PPOConfig,
    Preset,
    Recipe,
)

RECIPE = Recipe(
    name="pick_depth",
    about="Pick with the depth images of both cameras.",
    env=EnvConfig(env="HabPick-v1", control_mode="ee", obs_mode="depth"),
    # One network for actor and critic: two visual encoders would take twice the time.
    preset=Preset(
        network=NetworkConfig(state_layers=(256,), lstm_size=256, head_layers=(), log_std=-0.5),
        ppo=PPOConfig(
            learning_rate=3e-4,
            decays=False,
            value_weight=0.5,
            entropy_weight=1e-3,
            scales_rewards=True,
        ),
        rows=8,
        rollout_steps=100,
    ),
    total_steps=1_000_000,
    distill=Distillation(teacher="pick_blind"),
)
