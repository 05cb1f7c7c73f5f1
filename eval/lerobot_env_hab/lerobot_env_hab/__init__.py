"""The Home Assistant Benchmark for LeRobot: ``lerobot-eval --env.type=hab --env.task=HabPick-v1``.

LeRobot imports packages of this name's beginning, which registers the configuration.
"""

from lerobot_env_hab.config import HabEnvConfig, make_env

__all__ = ["HabEnvConfig", "make_env"]
