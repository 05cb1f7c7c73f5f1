"""Navigate with the paper's 20 base actions and a learned stop (S App. H.2)."""

from dataclasses import replace

from hab_ppo.recipe import RECURRENT, VISUAL, Distillation, EnvConfig, Recipe

# A robot that does not see walls cannot do well; a lower bound for policies with images. The
# episode is longer than those of the other skills, hence the larger discount factor.
NAVIGATE_BLIND = Recipe(
    name="navigate_blind",
    about="Navigate from the point to go to.",
    env=EnvConfig(env="HabNavigate-v1", control_mode="base_discrete", num_episodes=5000),
    preset=replace(RECURRENT, ppo=replace(RECURRENT.ppo, discount=0.995)),
    distill=Distillation(expert="shortest_path_action"),
)

# Learned by PPO alone. The expert that drives to the goal pose is hard to imitate: the policy does
# not observe this pose, only the point that another skill starts from it. Each action is executed
# for four steps (0.13 s), which saves images and shortens the way from an action to its reward.
# Actions are drawn, as the most likely ones can turn back and forth forever.
NAVIGATE_DEPTH = Recipe(
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
        VISUAL, ppo=replace(VISUAL.ppo, discount=0.98, epochs=3), rows=16, rollout_steps=50
    ),
    total_steps=1_400_000,
    draws_actions=True,
)
