"""Pick with arm and base (as in arXiv 2210.05064), no images.

A policy that can drive corrects where a navigation skill left the robot.
"""

from dataclasses import replace

from hab_ppo.recipes.pick_blind import RECIPE as STANDING

RECIPE = replace(
    STANDING,
    name="pick_mobile",
    about="Pick as `pick_blind` does, with base motion.",
    env=replace(STANDING.env, control_mode="ee_base"),
)
