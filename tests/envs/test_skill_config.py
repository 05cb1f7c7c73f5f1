"""Weights and thresholds of all skills, set by name: validation and effect."""

import gymnasium as gym
import pytest
from hab_eval.records.config import parse_numbers
from playing import actions, play

from hab_tasks.engine.skill_env import config_values, configured
from hab_tasks.envs import ENVS
from hab_tasks.errors import HabError, OptionError, UnknownNameError
from hab_tasks.skills.pick import PICK

SKILLS = [e for e in ENVS if hasattr(ENVS[e].env, "skill")]


def test_every_number_of_a_skill_can_be_changed():
    """For Pick, 30 success + 5 pickup + a quarter of a metre at 20 a metre."""
    assert PICK.changed({"weights.success": 30}).reward_bound == 40.0
    for env_id in SKILLS:
        skill = ENVS[env_id].env.skill
        known = config_values(skill.config)
        for name, value in known.items():
            changed = config_values(skill.changed({name: value + 1.0}).config)
            assert changed == {**known, name: value + 1.0}, env_id


def test_what_is_no_number_of_the_skill_is_refused():
    for changes, kind in (
        ({"weights.successes": 1.0}, UnknownNameError),
        ({"weights": 1.0}, UnknownNameError),
        ({"force_limit_n": "much"}, OptionError),
        ({"force_limit_n": float("nan")}, OptionError),
        ({"force_limit_n": -1.0}, OptionError),
        ({"force_limit_n": True}, OptionError),
    ):
        with pytest.raises(kind, match=r"skill_config.* of pick"):
            configured("pick", PICK.config, changes)
    for name in ("weights.force", "fly.weights.success", "pick.weights.successes"):
        with pytest.raises(HabError, match="skill_config"):
            gym.make("HabSetTable-v1", obs_mode="state", skill_config={name: 1.0})
    for words in ("force", "=1", "a=b", "a=nan"):
        with pytest.raises(HabError, match="--skill-config"):
            parse_numbers([words])


def test_an_environment_pays_by_its_own_weights(make):
    paid = []
    for weight in (20.0, 40.0):
        env = make(skill_config={"weights.distance": weight})
        env.reset(seed=3)
        steps = play(env, actions(env, 5, gripper=-1.0))
        paid.append([float(step[-1]["reward_terms"]["approach"]) for step in steps])
    assert any(paid[0])
    assert paid[1] == pytest.approx([2.0 * value for value in paid[0]])
    assert ENVS["HabPick-v1"].env.skill.config == PICK.config  # only that environment's changed


def test_a_task_names_the_skill_first(make):
    base = make("HabSetTable-v1", skill_config={"open_drawer.weights.success": 99.0}).unwrapped
    skills = {part.skill.name: part.skill for part in base.task.parts}
    assert skills["open_drawer"].config.weights.success == 99.0
    assert skills["close_drawer"].config.weights.success == 10.0
    # 99 success + 5 grab + 0.25 + 0.5.
    assert base.reward_bound == 104.75
