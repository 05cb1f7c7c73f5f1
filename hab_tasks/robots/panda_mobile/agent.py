"""`hab_panda_mobile`: ManiSkill's Panda on a base of our own."""

from mani_skill.agents.registration import register_agent

from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.panda_mobile import PANDA_MOBILE


@register_agent()
class HabPandaMobile(MobileManipulator):
    """Panda with the paper's control."""

    spec = PANDA_MOBILE
    uid = PANDA_MOBILE.uid
