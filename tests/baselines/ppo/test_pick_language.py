"""The agent that picks what an instruction names, and its network."""

import pytest
import torch
from hab_ppo.agent import WEIGHTS
from hab_ppo.grounding import CAMERAS, SHIPPED, STRIDE_PX, load, pick_language
from hab_ppo.grounding_training import look, measure, seen_of
from refusals import check_each, refused_by_call

from hab_tasks.agent_spaces import agent_setup
from hab_tasks.envs import ENVS
from hab_tasks.episodes import EpisodeRequest, load_episodes


@pytest.mark.render
def test_the_object_that_is_told_is_found_in_layouts_that_training_has_not_seen():
    request = EpisodeRequest(env_id="HabPick-v1", split="val")
    episodes = load_episodes(request, 40).episodes
    lessons, env = look(request, episodes), ENVS["HabPick-v1"].env
    network, _ = load(SHIPPED)
    asked = [env.instruct(episode) for episode in episodes]
    told = [{said: told[said]} for said, told in zip(asked, lessons.told, strict=True)]
    # 25 of 38 that are seen; one of the objects there at random would be right in about 9.
    right = measure(network, lessons._replace(told=told))
    assert right.sum() >= 20, f"{int(right.sum())} of {len(right)}"
    # What is seen of an object is near its center, by kinematics and camera alone.
    seen, objects = seen_of(lessons, list(range(40))), lessons.objects.long()
    surface_m = seen.points_m[:, ::STRIDE_PX, ::STRIDE_PX].reshape(*objects.shape, 3)
    rows, *_ = (objects > 0).nonzero(as_tuple=True)
    away_m = surface_m[objects > 0] - lessons.centers_m[rows, objects[objects > 0] - 1]
    assert away_m.norm(dim=1).quantile(0.95) < 0.15


def test_what_it_cannot_act_on_is_refused():
    agent = pick_language(agent_setup("HabPick-v1"))
    agent.reset(torch.ones(1, dtype=torch.bool), [0])
    felt = {"ee_position": torch.zeros(1, 3)}
    depth = {name: {"depth": torch.ones(1, 128, 128, 1)} for name in CAMERAS}
    foreign = {"weights": str(WEIGHTS / "pick_blind.safetensors")}

    def check(case):
        call, *words = case
        refused_by_call(call, *words)

    cases = (
        (lambda: pick_language(agent_setup("HabPlace-v1")), "acts in HabPick-v1, not HabPlace-v1"),
        (lambda: pick_language(agent_setup("HabPick-v1", options=foreign)), "not a file of"),
        (lambda: agent.act({"agent": felt}), "needs obs['instruction'] and color"),
        (
            lambda: agent.act({"agent": felt, "instruction": ["Pick."], "sensor_data": depth}),
            "needs obs['instruction'] and color",
        ),
    )
    check_each({str(number): case for number, case in enumerate(cases)}, check)
