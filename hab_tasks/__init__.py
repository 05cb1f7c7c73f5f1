"""The Home Assistant Benchmark of Habitat 2.0 as a ManiSkill task pack.

Importing this package only registers its environments. Afterwards ``gym.make("HabPick-v1")``
works; ``gym.make("hab_tasks:HabPick-v1")`` works without the import.

Public names; those that need torch or the simulator are imported when they are used:

- environments: `ENVS`, `HabError`, `SB3VecEnv`
- tasks: `TaskSpec`, `Target`, `register_task`, `receptacles`
- skills: `Skill`, `SkillEnv`, `register_skill`, `Requirements`, `PickStarts`, `ObsEntry`,
  `OBJECT_START`, `PROPRIOCEPTION`, `ARM_MODES`, `MOBILE_MODES`
- agents: `Agent`, `AgentSpec`, `AgentSetup`, `AgentReport`, `agent_setup`, `check_options`
- episodes: `Episode`, `EpisodeSet`, `EpisodeRequest`, `load_episodes`
"""

from typing import TYPE_CHECKING

from hab_tasks import receptacles
from hab_tasks.errors import HabError
from hab_tasks.registration import (
    names_on_demand,
    register_skill,
    register_skills,
    register_task,
)
from hab_tasks.task_spec import Target, TaskSpec
from hab_tasks.tasks.benchmark import PREPARE_GROCERIES, SET_TABLE, TIDY_HOUSE

if TYPE_CHECKING:
    from hab_tasks.agent import Agent, AgentReport, AgentSetup, AgentSpec, check_options
    from hab_tasks.agent_spaces import agent_setup
    from hab_tasks.engine.goals import Requirements
    from hab_tasks.engine.sensors import OBJECT_START, PROPRIOCEPTION, ObsEntry
    from hab_tasks.engine.skill_env import Skill, SkillEnv
    from hab_tasks.envs import ENVS
    from hab_tasks.episodes import Episode, EpisodeRequest, EpisodeSet, load_episodes
    from hab_tasks.robots.control_modes import ARM_MODES, MOBILE_MODES
    from hab_tasks.skills.pick import PickStarts
    from hab_tasks.vector.sb3 import SB3VecEnv

__version__ = "1.0.0"
__all__ = [
    "ARM_MODES",
    "ENVS",
    "MOBILE_MODES",
    "OBJECT_START",
    "PROPRIOCEPTION",
    "Agent",
    "AgentReport",
    "AgentSetup",
    "AgentSpec",
    "Episode",
    "EpisodeRequest",
    "EpisodeSet",
    "HabError",
    "ObsEntry",
    "PickStarts",
    "Requirements",
    "SB3VecEnv",
    "Skill",
    "SkillEnv",
    "Target",
    "TaskSpec",
    "__version__",
    "agent_setup",
    "check_options",
    "load_episodes",
    "receptacles",
    "register_skill",
    "register_task",
]

__getattr__, __dir__ = names_on_demand(
    __name__,
    {
        "agent": ("Agent", "AgentReport", "AgentSetup", "AgentSpec", "check_options"),
        "agent_spaces": ("agent_setup",),
        "engine.goals": ("Requirements",),
        "engine.sensors": ("OBJECT_START", "PROPRIOCEPTION", "ObsEntry"),
        "engine.skill_env": ("Skill", "SkillEnv"),
        "envs": ("ENVS",),
        "episodes": ("Episode", "EpisodeRequest", "EpisodeSet", "load_episodes"),
        "robots.control_modes": ("ARM_MODES", "MOBILE_MODES"),
        "skills.pick": ("PickStarts",),
        "vector.sb3": ("SB3VecEnv",),
    },
)

register_skills()
for _spec in (TIDY_HOUSE, PREPARE_GROCERIES, SET_TABLE):
    register_task(_spec, __name__)
