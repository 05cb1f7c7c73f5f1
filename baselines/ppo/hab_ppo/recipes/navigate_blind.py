"""Blind Navigate: only the point to go to, with the paper's 20 base actions (S App. H.2).

A robot that does not see walls cannot do well; a lower bound for policies with images. The episode
is longer than those of the other skills, hence the larger discount factor.
"""

from dataclasses import replace

from hab_ppo.recipe import RECURRENT, Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="navigate_blind",
    about="Navigate from the point to go to.",
    env=EnvConfig(env="HabNavigate-v1", control_mode="base_discrete", num_episodes=5000),
    preset=replace(RECURRENT, ppo=replace(RECURRENT.ppo, discount=0.995)),
    distill=Distillation(expert="shortest_path_action"),
)
