"""Robots with the paper's control, and the snap grasp."""

from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.panda_mobile import PANDA_MOBILE as PANDA_MOBILE  # registers it

DEFAULT_ROBOT = FETCH
"""The robot of environments, requests and sandboxes that name no other."""
