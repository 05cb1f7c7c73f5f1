import sys

import hab_eval
import pytest
import stub_hab
import torch
from hab_eval import random_agent
from hab_eval.errors import AgentError
from hab_eval.example_agent import RandomAgent
from hab_eval.load_agent import load_agent
from hab_eval.runner import run_episode

from hab_tasks.agent import Agent, AgentReport, AgentSetup, check_options
from hab_tasks.errors import UnknownNameError

SETUP = AgentSetup(env_id=stub_hab.ENV_ID)


def run(seed, agent, observers=()):
    episode = stub_hab.StubEpisode(id="e", scene_id="s", seed=seed)
    return run_episode(stub_hab.StubEnv(render=True), agent, 0, episode, observers)


@pytest.mark.parametrize(
    ("seed", "success", "steps", "failure"),
    [(0, True, 3, None), (1, False, 2, "force"), (2, False, 5, "timeout")],
)
def test_outcomes(seed, success, steps, failure):
    finished = run(seed, stub_hab.StubAgent())
    result = finished.episode
    assert (result.success, result.steps, result.failure) == (success, steps, failure)
    assert result.episode_return == pytest.approx(0.5 * steps)
    assert result.stages == {"reached": seed != 1}
    assert finished.timings_s == {"plan": 0.25}


def test_failure_is_the_environments_then_the_agents_then_timeout():
    agent = stub_hab.StubAgent(failure="target plan")
    assert run(0, agent).episode.failure is None
    assert run(1, agent).episode.failure == "force"
    assert run(2, agent).episode.failure == "target plan"


def test_true_state_only_on_request():
    blind, seeing, late = (stub_hab.StubAgent(privileged=truth) for truth in (False, True, True))
    late.act = lambda obs: late.seen.append(obs) or torch.zeros(1, 2)
    for agent in (blind, seeing, late):
        run(0, agent)
    assert all("privileged" not in obs for obs in blind.seen)
    assert seeing.truths == ["true state of e"] * len(seeing.seen) != []
    with pytest.raises(AgentError, match="only until the next step"):
        late.seen[0]["privileged"]


def test_agent_is_seeded_by_the_episode():
    agent = stub_hab.StubAgent()
    run(7, agent)
    assert agent.seeds == [7]


@pytest.mark.parametrize("value", [torch.zeros(1), float("nan"), {1, 2}])
def test_a_trace_that_is_no_json_is_named(value):
    agent = stub_hab.StubAgent()
    agent.report = lambda: [AgentReport(trace=({"value": value},))]
    with pytest.raises(AgentError, match="not JSON-serializable"):
        run(0, agent)


@pytest.mark.parametrize("action", [torch.zeros(2), torch.zeros(2, 2), [0.0, 0.0]])
def test_bad_actions_are_named(action):
    agent = stub_hab.StubAgent()
    agent.act = lambda obs: action
    with pytest.raises(AgentError, match=r"must return a \(1, A\) tensor"):
        run(0, agent)


def test_observers_see_everything_once():
    calls = []

    class Recorder:
        def start(self, index, episode, moment):
            calls.append(("start", index, episode.id, moment.step, moment.episode_return))

        def step(self, moment):
            assert moment.info["stages"]
            calls.append((moment.step, moment.reward, moment.episode_return, moment.doing))

        def end(self):
            calls.append("end")

        def abort(self):
            calls.append("abort")

    agent = stub_hab.StubAgent()
    agent.report = lambda: [AgentReport(doing=f"act {len(agent.seen)}")]
    run(1, agent, [Recorder()])
    # Each action pays 0.5.
    steps = [(1, 0.5, 0.5, "act 1"), (2, 0.5, 1.0, "act 2")]
    assert calls == [("start", 0, "e", 0, 0.0), *steps, "end"]
    calls.clear()
    broken = stub_hab.StubAgent()
    broken.act = lambda obs: None
    with pytest.raises(AgentError):
        run(1, broken, [Recorder()])
    assert calls == [("start", 0, "e", 0, 0.0), "abort"]


@pytest.mark.usefixtures("stubbed")
def test_random_agent_repeats_itself_and_stays_in_bounds():
    agent = random_agent(SETUP)
    assert isinstance(agent, Agent)
    assert isinstance(agent, RandomAgent)

    def actions(seed):
        agent.reset(torch.ones(1, dtype=torch.bool), [seed])
        return torch.cat([agent.act({}) for _ in range(50)])

    first = actions(3)
    assert first.shape == (50, 2)
    assert first.abs().max() <= 1
    assert torch.equal(first, actions(3))
    assert not torch.equal(first, actions(4))


def test_load_agent():
    assert isinstance(load_agent("stub_hab:constant", SETUP), stub_hab.StubAgent)


@pytest.mark.parametrize("reference", ["stub_hab", "stub_hab:", ":constant", ""])
def test_malformed_reference(reference):
    with pytest.raises(AgentError, match="module:factory"):
        load_agent(reference, SETUP)


def test_unknown_agents_name_the_nearest():
    with pytest.raises(AgentError, match="Did you mean 'hab_eval'"):
        load_agent("hab_evall:random_agent", SETUP)
    with pytest.raises(AgentError, match=r"not in the package 'hab_eval'.*'hab_eval.runner'"):
        load_agent("hab_eval.runer:x", SETUP)
    with pytest.raises(UnknownNameError, match="Did you mean 'random_agent'"):
        load_agent("hab_eval:randomagent", SETUP)
    with pytest.raises(UnknownNameError, match="Did you mean 'constant'") as caught:
        load_agent("stub_hab:constnt", SETUP)
    assert caught.value.valid == [
        "constant",
        "handy",
        "many",
        "not_an_agent",
        "optional",
        "raising",
        "telling",
    ]


def test_what_is_no_agent_is_refused():
    with pytest.raises(AgentError, match="needs spec, reset, act and report"):
        load_agent("stub_hab:not_an_agent", SETUP)


def test_missing_dependency_is_not_taken_for_an_unknown_module(tmp_path, monkeypatch):
    (tmp_path / "needs_more.py").write_text("import surely_not_installed\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(AgentError, match="'needs_more' needs 'surely_not_installed'"):
        load_agent("needs_more:agent", SETUP)


def test_the_working_directory_counts(tmp_path, monkeypatch):
    (tmp_path / "my_own_agent.py").write_text("import stub_hab\ngreedy = stub_hab.constant\n")
    monkeypatch.setattr(sys, "path", list(sys.path))
    with pytest.raises(AgentError, match="neither in the working directory"):
        load_agent("my_own_agent:greedy", SETUP)
    monkeypatch.chdir(tmp_path)
    assert isinstance(load_agent("my_own_agent:greedy", SETUP), stub_hab.StubAgent)
    with pytest.raises(AgentError, match=f"{tmp_path}.*Did you mean 'my_own_agent'"):
        load_agent("my_own_agnt:greedy", SETUP)


def setup_with(**options):
    return AgentSetup(env_id=stub_hab.ENV_ID, options=options)


def test_a_factory_refuses_options_that_it_does_not_know():
    known = {"navigation": ("oracle", "teleport"), "policy": None}
    check_options(setup_with(), {})
    check_options(setup_with(navigation="teleport", policy="any/file.pt"), known)
    with pytest.raises(UnknownNameError, match=r"option of the agent 'navigatoin'.*'navigation'"):
        check_options(setup_with(navigatoin="oracle"), known)
    with pytest.raises(UnknownNameError, match=r"navigation 'oracel'.*Did you mean 'oracle'"):
        check_options(setup_with(navigation="oracel"), known)


@pytest.mark.usefixtures("stubbed")
def test_the_random_agent_has_no_options():
    with pytest.raises(UnknownNameError, match=r"'speed'.*Valid: \(none\)"):
        random_agent(setup_with(speed="2"))


@pytest.mark.usefixtures("stubbed")
@pytest.mark.parametrize(
    ("name", "holding", "gripper"),
    [
        ("do_nothing", 1.0, 1.0),
        ("do_nothing", 0.0, -1.0),  # from 0 on the hand would close
        ("close_hand", 0.0, 1.0),
        ("open_hand", 1.0, -1.0),
    ],
)
def test_agents_that_stand_still_move_the_hand_at_most(name, holding, gripper):
    agent = load_agent(f"hab_eval:{name}", SETUP)
    agent.reset(torch.ones(1, dtype=torch.bool), [0])
    obs = {"agent": {"is_holding": torch.tensor([[holding]])}}
    # The stub's actions have two entries, the hand's is the second one.
    assert agent.act(obs).tolist() == [[0.0, gripper]]
    assert agent.report() == [AgentReport()]
    assert agent.spec.control_mode == "ee"


@pytest.mark.usefixtures("stubbed")
def test_agents_that_stand_still_have_names_of_their_own_and_no_options():
    names = [getattr(hab_eval, f)(SETUP).spec.name for f in ("do_nothing", "close_hand")]
    assert [*names, hab_eval.open_hand(SETUP).spec.name] == [
        "Do nothing",
        "Close the hand only",
        "Open the hand only",
    ]
    with pytest.raises(UnknownNameError, match=r"'hand'.*Valid: \(none\)"):
        hab_eval.do_nothing(setup_with(hand="open"))
