"""Robots with the paper's control, and the snap grasp."""

from hab_tasks.robots.fetch import FETCH

DEFAULT_ROBOT = FETCH
"""The robot of environments, requests and sandboxes that name no other."""
