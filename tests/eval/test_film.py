"""Video frames: images in a row, text below."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hab_eval import environments
from hab_eval.config import EvalConfig
from hab_eval.film import LINES, compose

from hab_tasks.agent import AgentSpec
from hab_tasks.captions import LINE_PX
from hab_tasks.envs import ENVS

render = pytest.mark.render
quick = ("HabPick-v1", "HabNavigate-v1")
few_envs = pytest.mark.parametrize(
    "env_id", [e if e in quick else pytest.param(e, marks=pytest.mark.slow) for e in ENVS]
)


def test_pictures_stand_in_a_row_and_words_below_never_grow_the_frame():
    sizes = ((64, 64, 50), (64, 96, 100), (128, 128, 150))
    views = [np.full((height, width, 3), shade, np.uint8) for height, width, shade in sizes]
    frame = compose(views, [])
    # 128 px high: 64 x 64 grows to 128 x 128, 64 x 96 to 128 x 192.
    assert frame.shape == (128 + LINES * LINE_PX, 128 + 192 + 128, 3)
    for start, end, shade in ((0, 128, 50), (128, 320, 100), (320, 448, 150)):
        assert np.all(frame[:128, start:end] == shade)
    for words, lines in (("", 0), ("one line", 1), ("many words " * 200, LINES)):
        told = compose(views, [words])
        assert told.shape == frame.shape
        strip = told[128:].reshape(LINES, LINE_PX, -1)
        assert (strip.max(axis=(1, 2)) > 0).sum() == lines


@pytest.mark.slow
@render
@few_envs
def test_views_are_in_colour_whatever_the_agent_sees(env_id):
    """The same episode for an agent of states and for one of depth; Navigate has no arm camera."""
    spec = AgentSpec(name="x", control_mode=environments.continuous_control(env_id))
    config = EvalConfig(agent="x:y", env=env_id)
    shown = []
    for obs_mode in ("state", "depth"):
        one = replace(spec, obs_mode=obs_mode)
        env = environments.make_env(config, one, split="val", render=True, num_episodes=3)
        first, _ = env.reset(seed=1, options={"episode": 1})
        views = env.unwrapped.render_views()
        assert list(views) == ["head", "arm"]
        for view in views.values():
            assert view.shape == (1, 256, 256, 3)
            assert view.dtype == torch.uint8
            assert (view[..., 0] != view[..., 2]).float().mean() > 0.2
            assert view.float().std() > 5
        assert not torch.equal(views["head"], views["arm"])
        shown.append(views)
        if obs_mode == "depth":  # what the agent sees is untouched
            again = env.unwrapped.look()["sensor_data"]
            assert torch.equal(again["head"]["depth"], first["sensor_data"]["head"]["depth"])
        # Made anew with the simulation, the cameras show the new one.
        env.reset(seed=1, options={"episode": 2, "reconfigure": True})
        assert not torch.equal(env.unwrapped.render_views()["head"], views["head"])
        env.close()
    for name in shown[0]:
        assert torch.equal(shown[0][name], shown[1][name])
