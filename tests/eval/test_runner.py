import sys

import pytest
import stub_hab
import torch
from hab_eval import random_agent
from hab_eval.errors import AgentError
from hab_eval.run.agents import load_agent
from hab_eval.run.runner import run_episode

from hab_tasks.agent import Agent, AgentReport, AgentSetup, check_options
from hab_tasks.errors import UnknownNameError


def setup_with(**options):
    return AgentSetup(env_id=stub_hab.ENV_ID, options=options)


SETUP = setup_with()


def run(seed, agent):
    episode = stub_hab.StubEpisode(id="e", scene_id="s", seed=seed)
    return run_episode(stub_hab.StubEnv(render=True), agent, 0, episode)


def test_outcomes():
    for seed, steps, failure in ((0, 3, None), (1, 2, "force"), (2, 5, "timeout")):
        agent = stub_hab.StubAgent()
        finished = run(seed, agent)
        result = finished.episode
        assert (result.success, result.steps, result.failure) == (seed == 0, steps, failure)
        assert result.episode_return == pytest.approx(0.5 * steps)
        assert result.stages == {"reached": seed != 1}
        assert finished.timings_s == {"plan": 0.25}
        assert agent.seeds == [seed]
    # Of two failures that of the environment counts, then the agent's.
    agent = stub_hab.StubAgent(failure="target plan")
    failures = [run(seed, agent).episode.failure for seed in range(3)]
    assert failures == [None, "force", "target plan"]


@pytest.mark.usefixtures("stubbed")
def test_random_agent_repeats_itself_and_stays_in_bounds():
    agent = random_agent(SETUP)
    assert isinstance(agent, Agent)

    def actions(seed):
        agent.reset(torch.ones(1, dtype=torch.bool), [seed])
        return torch.cat([agent.act({}) for _ in range(50)])

    first = actions(3)
    assert first.shape == (50, 2)
    assert first.abs().max() <= 1
    assert torch.equal(first, actions(3))
    assert not torch.equal(first, actions(4))


def test_unknown_agents_name_the_nearest():
    with pytest.raises(AgentError, match="Did you mean 'hab_eval'"):
        load_agent("hab_evall:random_agent", SETUP)
    with pytest.raises(AgentError, match=r"not in the package 'hab_eval.run'.*run.runner'"):
        load_agent("hab_eval.run.runer:x", SETUP)
    with pytest.raises(UnknownNameError, match="Did you mean 'constant'"):
        load_agent("stub_hab:constnt", SETUP)


def test_the_working_directory_counts(tmp_path, monkeypatch):
    (tmp_path / "my_own_agent.py").write_text("import stub_hab\ngreedy = stub_hab.constant\n")
    monkeypatch.setattr(sys, "path", list(sys.path))
    with pytest.raises(AgentError, match="neither in the working directory"):
        load_agent("my_own_agent:greedy", SETUP)
    monkeypatch.chdir(tmp_path)
    assert isinstance(load_agent("my_own_agent:greedy", SETUP), stub_hab.StubAgent)
    with pytest.raises(AgentError, match=f"{tmp_path}.*Did you mean 'my_own_agent'"):
        load_agent("my_own_agnt:greedy", SETUP)


def test_a_factory_refuses_options_that_it_does_not_know():
    known = {"navigation": ("oracle", "teleport"), "policy": None}
    check_options(setup_with(), {})
    check_options(setup_with(navigation="teleport", policy="any/file.pt"), known)
    with pytest.raises(UnknownNameError, match=r"navigation 'oracel'.*Did you mean 'oracle'"):
        check_options(setup_with(navigation="oracel"), known)


@pytest.mark.usefixtures("stubbed")
def test_agents_that_stand_still_move_the_hand_at_most():
    for name, holding, gripper in (
        ("do_nothing", 1.0, 1.0),
        ("do_nothing", 0.0, -1.0),  # from 0 on the hand would close
        ("close_hand", 0.0, 1.0),
        ("open_hand", 1.0, -1.0),
    ):
        agent = load_agent(f"hab_eval:{name}", SETUP)
        agent.reset(torch.ones(1, dtype=torch.bool), [0])
        obs = {"agent": {"is_holding": torch.tensor([[holding]])}}
        # The stub's actions have two entries, the hand's is the second one.
        assert agent.act(obs).tolist() == [[0.0, gripper]], name
        assert agent.report() == [AgentReport()]
