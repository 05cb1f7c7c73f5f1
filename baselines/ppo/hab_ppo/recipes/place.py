"""Place (S App. H.2): with and without images.

A dropped object cannot be taken again, so PPO alone settles for throwing it from some distance,
which succeeds in two of three episodes. All recipes start from demonstrations or an expert.
"""

from dataclasses import replace

from hab_ppo.recipe import VISUAL, Cloning, Distillation, EnvConfig, FineTuning, Recipe, WarmStart

IN_FRIDGE = "hab_ppo.fridge_starts:PlaceOftenInFridge-v1"

PLACE_BLIND = Recipe(
    name="place_blind",
    about="Place from the arm's state and the object's goal.",
    env=EnvConfig(env="HabPlace-v1", control_mode="ee", num_episodes=5000),
    total_steps=1_500_000,
    warm_start=WarmStart(),
)

# Arm and base as in arXiv 2210.05064: corrects where a navigation skill left the robot.
PLACE_MOBILE = replace(
    PLACE_BLIND,
    name="place_mobile",
    about="Place as `place_blind` does, with base motion.",
    env=replace(PLACE_BLIND.env, control_mode="ee_base"),
)

# The expert brings the hand all the way to rest, where `place_blind` slows down as soon as its
# episodes end; so this policy also finishes from the states in which another skill hands over.
PLACE_DISTILLED = Recipe(
    name="place_distilled",
    about="Blind Place, distilled from an expert and fine-tuned.",
    env=EnvConfig(env="HabPlace-v1", control_mode="ee", num_episodes=2000),
    total_steps=100_000,
    distill=Distillation(expert="place_action", rounds=8),
)

# Two of the three tasks place into the fridge: `place_distilled` solves 37 of 62 test episodes
# there, 423 of 438 elsewhere.
PLACE_FRIDGE = replace(
    PLACE_DISTILLED,
    name="place_fridge",
    about="Blind Place, distilled from an expert, with half of the goals in the fridge.",
    env=replace(PLACE_DISTILLED.env, trained_in=IN_FRIDGE),
    distill=Distillation(
        expert="place_action",
        rounds=14,
        tuning=FineTuning(log_std=-1.6, kl_weight=0.2, kl_steps=300_000),
    ),
)

# Rendering is expensive, so an expert that knows all objects labels the visited states (DAgger).
PLACE_DEPTH = replace(
    PLACE_FRIDGE,
    name="place_depth",
    about="Place with the depth images of both cameras.",
    env=replace(PLACE_FRIDGE.env, obs_mode="depth"),
    preset=VISUAL,
    distill=Distillation(
        expert="place_action",
        rounds=9,
        cloning=Cloning(epochs=10, patience=10, bfloat16=True),
        tuning=FineTuning(log_std=-1.6, kl_weight=0.2, kl_steps=300_000),
    ),
)
