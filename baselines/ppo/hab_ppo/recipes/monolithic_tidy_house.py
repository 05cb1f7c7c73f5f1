"""MonolithicRL in TidyHouse: one policy for the whole task (S App. H.3, Fig. 24).

Arm, gripper and base, both depth cameras, starts and goals of all objects; the reward is that of
the current skill. The paper's learner and length; far beyond two CPU cores.
"""

from hab_ppo.recipe import PAPER, EnvConfig, Recipe

RECIPE = Recipe(
    name="monolithic_tidy_house",
    about="TidyHouse with one policy, from depth images.",
    env=EnvConfig(
        env="HabTidyHouse-v1", control_mode="ee_base", obs_mode="depth", num_episodes=5000
    ),
    preset=PAPER,
    total_steps=100_000_000,
    evaluation_steps=1_000_000,
)
