"""Plans executed by untrained skills: order, hand-over, time limits, rows, and own tasks."""

import json
from types import SimpleNamespace

import gymnasium as gym
import hab_tp_srl
import numpy as np
import pytest
import torch
from hab_navigator.network import GoalNetwork, save
from hab_navigator.robot_map import RobotMap
from hab_plans.plan import plan_of
from hab_plans.stage import stage_of
from hab_spa.motion.robot import Robot, SpaConfig
from hab_tp_srl import factories, policies
from hab_tp_srl.navigators import NavigatorPolicy
from hab_tp_srl.policies import SkillPolicy, Turn
from hab_tp_srl.scenes import ObservedScene
from hab_tp_srl.skill import command_of
from hab_tp_srl.view import TaskView

from hab_tasks.agent_spaces import agent_setup
from hab_tasks.robots.control_modes import BASE_CELLS
from hab_tasks.robots.fetch import FETCH

TASK = "HabSetTable-v1"
STEPS = 3
"""Horizon of the skills in these tests."""


class BriefPolicy(SkillPolicy):
    """A skill that soon times out; notes in which rows it starts anew."""

    notes: list = []  # noqa: RUF012

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.horizon_steps = STEPS

    def decide(self, rows, turns, obs):
        self.notes.append((self.name, tuple(rows), tuple(turn.memory is None for turn in turns)))
        super().decide(rows, turns, obs)


@pytest.fixture
def brief(monkeypatch):
    """Returns the notes (policy, rows, starts) of all policies."""
    monkeypatch.setattr(factories, "SkillPolicy", BriefPolicy)
    monkeypatch.setattr(BriefPolicy, "notes", [])
    return BriefPolicy.notes


@pytest.fixture
def handed_over(learned):
    """Makes teams that start a skill without resetting the arm."""

    def make(**options):
        given = {**learned, "reset_arm": "off", **options}
        return hab_tp_srl.tp_srl(agent_setup(TASK, options=given))

    return make


def make_env(spec, seed=0, task=f"hab_tasks:{TASK}"):
    env = gym.make(
        task,
        obs_mode=spec.obs_mode,
        render_backend="none" if spec.obs_mode == "state_dict" else "rays",
        num_episodes=2,
        control_mode=spec.control_mode,
        handle_position=spec.handle_position,
    )
    obs, _ = env.reset(seed=seed, options={"episode": seed})
    return env, obs


def joined(observations):
    """The observation of several rows."""
    return {
        group: {name: torch.cat([obs[group][name] for obs in observations]) for name in values}
        for group, values in observations[0].items()
    }


def test_rows_act_together_and_as_they_would_alone(brief, handed_over):
    both, *alone = (handed_over(actions="drawn") for _ in range(3))
    envs, observations = zip(*(make_env(both.spec, seed) for seed in (0, 1)), strict=True)
    both.reset(torch.tensor([True, True]), [0, 1])
    for seed, agent in enumerate(alone):
        agent.reset(torch.tensor([True]), [seed])
    stages = plan_of(TASK).interactions
    motions = 2 * sum(action.skill != "place" for action in stages)
    for _ in range(motions * STEPS + 2):
        before = len(brief)
        actions = both.act(joined(observations))
        assert all(rows == (0, 1) for _, rows, _ in brief[before:])
        single = [agent.act(obs) for agent, obs in zip(alone, observations, strict=True)]
        np.testing.assert_allclose(actions, torch.cat(single), atol=1e-5)
        observations = [env.step(a)[0] for env, a in zip(envs, single, strict=True)]
    for env in envs:
        env.close()
    # Every stage was tried once, in order, for as long as its policies may act.
    expected = []
    for action in stages:
        if action.skill == "place":  # nothing was picked
            expected.append(("place", 0, "execution"))
        else:
            expected += [(name, STEPS, "timeout") for name in ("navigate", action.skill)]
    for report in both.report():
        did = [(entry["did"], entry["steps"], entry["outcome"]) for entry in report.trace]
        assert did == expected
        assert (report.failure, report.doing) == ("navigate timeout", "failed: timeout")
        json.dumps(report.trace)
    assert both.report() == [agent.report()[0] for agent in alone]
    anew = [(True, True)] + [(False, False)] * (STEPS - 1)
    assert [starts for _, rows, starts in brief if rows == (0, 1)] == anew * motions


def test_the_actions_of_an_arm_that_stands_still_are_drawn(brief, handed_over, monkeypatch):
    monkeypatch.setattr(policies, "STILL_STEPS", 2)
    acted = []
    for seed in (0, 1):
        agent = handed_over()
        env, obs = make_env(agent.spec)
        agent.reset(torch.tensor([True]), [seed])
        # Navigation, then a skill that observes the same arm three times.
        acted.append([np.asarray(agent.act(obs)) for _ in range(2 * STEPS)])
        env.close()
    same = [np.array_equal(one, other) for one, other in zip(*acted, strict=True)]
    assert same == [True] * 5 + [False]


def test_a_row_that_starts_again_forgets_its_episode(brief, handed_over):
    agent = handed_over()
    env, obs = make_env(agent.spec)
    agent.reset(torch.tensor([True, True]), [0, 1])
    for _ in range(STEPS + 1):
        agent.act(joined([obs, obs]))
    agent.reset(torch.tensor([False, True]), [0, 2])
    agent.act(joined([obs, obs]))
    names = {name: (rows, starts) for name, rows, starts in brief[-2:]}
    assert names["navigate_blind"] == ((1,), (True,))
    assert names["open_drawer_blind"] == ((0,), (False,))
    assert [len(report.trace) for report in agent.report()] == [2, 1]
    env.close()


def test_the_arm_is_reset_before_a_skill(brief, handed_over):
    rest = torch.tensor(FETCH.rest_qpos_rad)
    for options, did in (({"reset_arm": "on"}, ["reset", "navigate"]), ({}, ["navigate"])):
        agent = handed_over(**options)
        env, obs = make_env(agent.spec)
        assert float((obs["agent"]["arm_qpos"][0] - rest).abs().max()) > 0.05  # the start is noisy
        agent.reset(torch.tensor([True]), [0])
        while not any(entry["did"] == "navigate" for entry in agent.report()[0].trace):
            obs = env.step(agent.act(obs))[0]
        env.close()
        assert [entry["did"] for entry in agent.report()[0].trace] == did
        if options:
            assert agent.report()[0].trace[0]["outcome"] == "done"
            assert float((obs["agent"]["arm_qpos"][0] - rest).abs().max()) < 0.05


# The hand; the hand and the base; cells of the base.
@pytest.mark.parametrize("name", ["pick_blind", "open_fridge_blind", "navigate_blind"])
def test_an_action_does_in_a_task_what_it_does_in_the_skills_env(name, weights):
    """The same arm targets and base velocities as those of the task's own mode ``ee_base``."""
    policy = SkillPolicy(agent_setup(TASK), name.removesuffix("_blind"), weights[name])
    rng, view = np.random.default_rng(0), TaskView(truth=False)
    plain = {"obs_mode": "state_dict", "render_backend": "none", "num_episodes": 1}
    modes = ("ee_base", "joint_target_base")
    envs = [gym.make(f"hab_tasks:{TASK}", control_mode=mode, **plain) for mode in modes]
    seen = [env.reset(seed=0)[0] for env in envs]
    scene = ObservedScene(FETCH, view)
    scene.see(seen[1], 0)
    robot = Robot(scene, SpaConfig(), seed=0, deadline=100)  # type: ignore[arg-type]
    for _ in range(25):
        scene.see(seen[1], 0)
        own = np.zeros(6, dtype=np.float32)
        if name == "navigate_blind":
            action = np.array([rng.integers(20)], dtype=np.float32)
        else:
            action = own[: 6 if policy.control.base == "velocity" else 4]
            action[:] = rng.uniform(-1, 1, len(action))
        own[3] = -1.0
        command = command_of(robot, policy, action)
        own[4:] = command.base
        given = np.array([*command.arm_rad, -1.0, *command.base], dtype=np.float32)
        seen = [envs[0].step(own)[0], envs[1].step(given)[0]]
        for group in ("agent", "extra"):
            torch.testing.assert_close(*(obs[group] for obs in seen), rtol=0, atol=0)
    for env in envs:
        env.close()


@pytest.mark.slow
def test_the_navigator_decides_every_four_steps_on_one_map_of_the_episode(tmp_path, monkeypatch):
    path = tmp_path / "navigator.safetensors"
    save(path, GoalNetwork(), {"kind": "navigator"})
    policy = NavigatorPolicy(agent_setup(TASK), path)
    mode = {"control_mode": "joint_target_base", "obs_mode": "depth", "handle_position": False}
    env, obs = make_env(SimpleNamespace(**mode))
    view = TaskView(truth=False)
    ObservedScene(FETCH, view).see(obs, 0)
    stage = stage_of(env.unwrapped.task, plan_of(TASK).interactions[0])
    looks, look = [], RobotMap.look

    def noted(*arguments):
        looks.append(arguments)
        return look(*arguments)

    monkeypatch.setattr(RobotMap, "look", noted)
    turn = Turn(policy=policy)
    turn.entries = view.entries(stage, view.point(stage))
    for step in range(5):
        policy.decide([0], [turn], obs)
        assert len(looks) == 1 + step // 4
        assert 0 <= int(turn.action[0]) < len(BASE_CELLS)
    env.close()
    map_, depth, point_m, _ = looks[0]
    assert np.array_equal(depth, obs["sensor_data"]["head"]["depth"][0])
    assert point_m == pytest.approx(turn.entries["extra", "point_in_base"])
    assert (map_.seen > 0).sum() > 100
    # A further attempt goes on with the map, as does the next stage, and decides at once.
    assert policy.goes_on(turn)
    again = Turn(policy=policy, entries=turn.entries, base=view.base, before=turn)
    for later in (turn, again):
        policy.decide([0], [later], obs)
        assert looks[-1][0] is map_
    assert len(looks) == 4
    assert looks[-1][3] == pytest.approx([0.0, 0.0, 0.0])
    # Another episode begins with an empty one.
    policy.decide([0], [Turn(policy=policy, entries=turn.entries)], obs)
    assert looks[-1][0] is not map_


@pytest.mark.slow
def test_a_policy_sees_the_images_of_its_rows(brief, weights, learned):
    options = {**learned, "pick": str(weights["pick_depth"])}
    agent = hab_tp_srl.tp_srl(agent_setup("HabTidyHouse-v1", options=options))
    env, obs = make_env(agent.spec, task="hab_tasks:HabTidyHouse-v1")
    agent.reset(torch.tensor([True]), [0])
    for _ in range(50):
        obs, *_ = env.step(agent.act(obs))
    env.close()
    (report,) = agent.report()
    assert report.doing.startswith("failed")
    stages = {entry["stage"]: entry["skill"] for entry in report.trace if "stage" in entry}
    assert [stages[number] for number in sorted(stages)] == ["pick", "place"] * 5
    assert "pick_depth" in {name for name, _, _ in brief}
