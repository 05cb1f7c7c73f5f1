"""Observations of agents: images on demand are rendered when read, and equal the usual ones."""

from dataclasses import replace

import pytest
import stub_hab
import torch
from hab_eval.errors import AgentError
from hab_eval.records.config import EvalConfig
from hab_eval.run import environments
from hab_eval.run.observations import AgentView, batched
from hab_eval.run.runner import run_episode

from hab_tasks.agent import AgentSpec, of_rows
from hab_tasks.errors import HabError

PICK = EvalConfig(agent="stub_hab:constant", env="HabPick-v1")
DEPTH = AgentSpec(name="Looker", control_mode="ee", obs_mode="depth", looks="on demand")


def test_images_are_rendered_once_and_only_when_read():
    env = stub_hab.StubEnv(render=False)
    seen, missed = (AgentView(DEPTH)(env, {"agent": 1}) for _ in range(2))
    assert list(seen) == ["agent", "sensor_param", "sensor_data"]
    assert "privileged" not in seen
    assert seen["agent"] == 1
    assert env.looks == 0
    picture = seen["sensor_data"]
    assert picture == {"head": 0}
    assert seen["sensor_param"] == {}
    with pytest.raises(KeyError):
        seen["privileged"]
    # Images of the past are kept but not made.
    for one in (seen, missed):
        one.expire()
    assert seen["sensor_data"] is picture
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
    agents = [{"agent": torch.full((1, 2), eye.number)} for eye in eyes]
    obs = batched([AgentView(DEPTH)(eye, one) for eye, one in zip(eyes, agents, strict=True)])
    assert list(obs) == ["agent", "sensor_param", "sensor_data"]
    assert obs["agent"].tolist() == [[0, 0], [1, 1], [2, 2]]
    assert of_rows(obs, [2])["agent"].tolist() == [[2, 2]]
    assert [eye.looks for eye in eyes] == [0, 0, 0]
    assert of_rows(obs, [2, 0])["sensor_data"]["head"][:, 0].tolist() == [2, 0]
    assert [eye.looks for eye in eyes] == [1, 0, 1]
    assert obs["sensor_data"]["head"][:, 0].tolist() == [0, 1, 2]
    assert [eye.looks for eye in eyes] == [1, 1, 1]
    # Rows of rendered observations are chosen too.
    obs = {"agent": {"qpos": torch.arange(6).view(3, 2)}, "privileged": ["a", "b", "c"]}
    chosen = of_rows(obs, [2, 0])
    assert chosen["agent"]["qpos"].tolist() == [[4, 5], [0, 1]]
    assert chosen["privileged"] == ["c", "a"]


def test_ways_to_look_that_cannot_be_are_named():
    for spec, message in (
        (replace(DEPTH, looks="on-demand"), "Did you mean 'on demand'"),
        (replace(DEPTH, obs_mode="state_dict"), "obs_mode is 'state_dict'"),
    ):
        with pytest.raises(HabError, match=message):
            environments.make_env(PICK, spec, split="val", render=False)


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
            seen = AgentView(spec)(demand, obs)
            assert seen.keys() == rendered.keys()
            for name in rendered:
                torch.testing.assert_close(seen[name], rendered[name], rtol=0, atol=0)
            depth = seen["sensor_data"]["arm"]["depth"]
            assert depth.dtype == torch.float32
            assert 0.0 <= depth.min() < depth.max() <= 1.0  # scaled: 1 is 10 m
            assert before is None or not torch.equal(before, depth)
            before = depth
        rendered, *_ = always.step(action)
        obs, *_ = demand.step(action)
    always.close()
    demand.close()
