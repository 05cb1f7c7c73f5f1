"""Navigate with a map that the policy draws of its depth images (`hab_ppo.map_memory`).

DAgger from an expert that knows the map, then PPO. It does not know the goal pose, but stops at
likely ones, one after another, as the policy can, whose map shows where it has stopped before. Each
action is executed for four steps, as in `navigate_depth`, and actions are drawn.
"""

from dataclasses import replace

from hab_ppo.recipe import VISUAL, Cloning, Distillation, FineTuning, NetworkConfig
from hab_ppo.recipes.navigate_depth import RECIPE as DEPTH

RECIPE = replace(
    DEPTH,
    name="navigate_mapped",
    about="Navigate with a map drawn from the depth images of the head camera.",
    env=replace(DEPTH.env, map_memory=True),
    preset=replace(
        VISUAL,
        network=NetworkConfig(state_layers=(64,), head_layers=(256,)),
        ppo=replace(VISUAL.ppo, discount=0.98, epochs=3, minibatches=4),
        rows=16,
        rollout_steps=100,
    ),
    distill=Distillation(
        expert="search_action",
        rounds=30,
        round_steps=10_000,
        most_mb=2500,
        cloning=Cloning(
            epochs=2,
            learning_rate=5e-4,
            batch_steps=250,
            bfloat16=True,
            stop_weight=2.0,
            mirrors=True,
        ),
        tuning=FineTuning(kl_weight=0.1, kl_steps=200_000),
    ),
)
