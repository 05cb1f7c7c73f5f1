"""`hab_fetch`: ManiSkill's Fetch with the paper's control, cameras and rest pose."""

from mani_skill.agents.registration import register_agent

from hab_tasks.robots.fetch import FETCH, FETCH_FRICTION
from hab_tasks.robots.mobile_manipulator import MobileManipulator


@register_agent()
class HabFetch(MobileManipulator):
    """Fetch with torso, head and fingers locked as in the paper."""

    spec = FETCH
    uid = FETCH.uid


@register_agent()
class HabFetchFriction(MobileManipulator):
    """Fetch whose fingers grasp by friction."""

    spec = FETCH_FRICTION
    uid = FETCH_FRICTION.uid
