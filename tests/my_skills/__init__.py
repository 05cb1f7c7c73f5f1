"""A user-defined skill."""

import hab_tasks

hab_tasks.register_skill("Reach-v1", "my_skills.reach:ReachEnv", horizon_steps=100)
