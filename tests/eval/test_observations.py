"""Observations of agents: images on demand are rendered when read, and equal the usual ones."""

from dataclasses import replace

import pytest
import stub_hab
import torch
from hab_eval import environments
from hab_eval.config import EvalConfig
from hab_eval.errors import AgentError
from hab_eval.observations import LazyObservation, agent_view, batched
from hab_eval.runner import run_episode

from hab_tasks.agent import AgentSpec, of_rows
from hab_tasks.errors import OptionError, UnknownNameError

PICK = EvalConfig(agent="stub_hab:constant", env="HabPick-v1")
DEPTH = AgentSpec(name="Looker", control_mode="ee", obs_mode="depth", looks="on demand")


def seen_of(env):
    return agent_view(env, DEPTH, {"agent": 1})


def test_images_are_rendered_once_and_only_when_read():
    env = stub_hab.StubEnv(render=False)
    seen = seen_of(env)
    assert list(seen) == ["agent", "sensor_param", "sensor_data"]
    assert len(seen) == 3
    assert "sensor_data" in seen
    assert "privileged" not in seen
    assert seen["agent"] == 1
    assert env.looks == 0
    assert seen["sensor_data"] == {"head": 0}
    assert seen["sensor_param"] == {}
    assert dict(seen)["sensor_data"] == {"head": 0}
    assert env.looks == 1
    with pytest.raises(KeyError):
        seen["privileged"]


def test_images_of_the_past_are_kept_but_not_made():
    env = stub_hab.StubEnv(render=False)
    looked, missed = seen_of(env), seen_of(env)
    picture = looked["sensor_data"]
    for seen in (looked, missed):
        seen.expire()
    assert looked["sensor_data"] is picture
    with pytest.raises(AgentError, match="only until the next step"):
        missed["sensor_data"]
    assert env.looks == 1


@pytest.mark.parametrize("privileged", [False, True])
def test_an_agent_looks_when_it_wants_to(privileged):
    """Seed 2 lasts five steps; the agent looks in the second and the fourth."""
    env, agent = stub_hab.StubEnv(render=False), stub_hab.StubAgent(privileged=privileged)
    agent.spec = replace(agent.spec, looks="on demand")
    saw = []

    def act(obs):
        agent.seen.append(obs)
        if len(agent.seen) % 2 == 0:
            saw.append(obs["sensor_data"]["head"])
        return torch.zeros(1, 2)

    agent.act = act
    episode = stub_hab.StubEpisode(id="e", scene_id="s", seed=2)
    assert run_episode(env, agent, 0, episode).episode.steps == 5
    assert saw == [1, 3]  # the stub's picture is the number of steps before it
    assert env.looks == 2
    assert all(("privileged" in obs) == privileged for obs in agent.seen)
    with pytest.raises(AgentError, match="only until the next step"):
        agent.seen[0]["sensor_data"]


class Eye:
    """An environment of which only the images matter; all their numbers are `number`."""

    def __init__(self, number):
        self.number, self.looks = number, 0

    @property
    def unwrapped(self):
        return self

    def look(self):
        self.looks += 1
        return {"sensor_param": {}, "sensor_data": {"head": torch.full((1, 4), self.number)}}


def test_of_a_batch_only_those_rows_are_rendered_that_are_read():
    eyes = [Eye(number) for number in range(3)]
    obs = batched(
        [agent_view(eye, DEPTH, {"agent": torch.full((1, 2), eye.number)}) for eye in eyes]
    )
    assert list(obs) == ["agent", "sensor_param", "sensor_data"]
    assert (len(obs), "sensor_data" in obs, "privileged" in obs) == (3, True, False)
    assert obs["agent"].tolist() == [[0, 0], [1, 1], [2, 2]]
    assert of_rows(obs, [2])["agent"].tolist() == [[2, 2]]
    assert [eye.looks for eye in eyes] == [0, 0, 0]
    assert of_rows(obs, [2, 0])["sensor_data"]["head"][:, 0].tolist() == [2, 0]
    assert of_rows(obs, [2])["sensor_data"]["head"].shape == (1, 4)
    assert [eye.looks for eye in eyes] == [1, 0, 1]
    assert obs["sensor_data"]["head"][:, 0].tolist() == [0, 1, 2]
    assert [eye.looks for eye in eyes] == [1, 1, 1]
    with pytest.raises(KeyError):
        obs["privileged"]


def test_rows_of_rendered_observations_are_chosen_too():
    obs = {"agent": {"qpos": torch.arange(6).view(3, 2)}, "privileged": ["a", "b", "c"]}
    chosen = of_rows(obs, [2, 0])
    assert chosen["agent"]["qpos"].tolist() == [[4, 5], [0, 1]]
    assert chosen["privileged"] == ["c", "a"]


def test_unknown_ways_to_look_are_named():
    spec = replace(DEPTH, looks="on-demand")  # pyright: ignore[reportArgumentType]
    with pytest.raises(UnknownNameError, match="Did you mean 'on demand'"):
        environments.make_env(PICK, spec, split="val", render=False)


def test_there_is_nothing_to_look_at_in_the_state():
    with pytest.raises(OptionError, match="obs_mode is 'state_dict'"):
        environments.make_env(
            PICK, replace(DEPTH, obs_mode="state_dict"), split="val", render=False
        )


@pytest.mark.parametrize(
    "obs_mode",
    ["depth", pytest.param("rgb+depth", marks=[pytest.mark.slow, pytest.mark.render])],
)
def test_pictures_on_demand_are_those_of_every_step(obs_mode):
    """Two environments with the same motions: one renders each step, the other in two of them."""
    spec = replace(DEPTH, obs_mode=obs_mode)
    always, demand = (
        environments.make_env(PICK, one, split="val", render=False, num_episodes=3)
        for one in (replace(spec, looks="always"), spec)
    )
    rendered, _ = always.reset(seed=3, options={"episode": 2})
    obs, _ = demand.reset(seed=3, options={"episode": 2})
    action = torch.tensor([[1.0, 0.0, -1.0, -1.0]])  # the hand moves, and the arm camera with it
    before = None
    for step in range(7):
        assert set(obs) == {"agent", "extra"}
        if step in (0, 6):
            seen = agent_view(demand, spec, obs)
            assert isinstance(seen, LazyObservation)
            assert_same(dict(seen), rendered)
            depth = seen["sensor_data"]["arm"]["depth"]
            assert depth.dtype == torch.float32
            assert 0.0 <= depth.min() < depth.max() <= 1.0  # scaled: 1 is 10 m
            assert before is None or not torch.equal(before, depth)
            before = depth
        rendered, *_ = always.step(action)
        obs, *_ = demand.step(action)
    always.close()
    demand.close()


def assert_same(one, other):
    """Both hold the same groups of the same numbers."""
    if isinstance(one, torch.Tensor):
        assert torch.equal(one, other)
        return
    assert set(one) == set(other)
    for name in one:
        assert_same(one[name], other[name])
