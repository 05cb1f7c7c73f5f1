"""Demonstrations, in the formats of ManiSkill and LeRobot."""
