"""PhysX on a GPU: batches of environments, compared with the CPU."""

import gymnasium as gym
import pytest
import torch
from playing import flat

import hab_tasks  # noqa: F401
from hab_tasks.envs import ENVS

ROWS = 3
pytestmark = [pytest.mark.gpu, pytest.mark.timeout(600)]


def make(env_id, rows, backend):
    return gym.make(
        env_id, num_envs=rows, sim_backend=backend, obs_mode="state_dict", num_episodes=ROWS
    )


@pytest.mark.parametrize("env_id", ENVS)
def test_rows_start_as_on_the_cpu(env_id):
    together = make(env_id, ROWS, "physx_cuda")
    alone = make(env_id, 1, "physx_cpu")
    obs, _ = together.reset(seed=0)
    for row, episode in enumerate(together.unwrapped.episode):
        one, _ = alone.reset(seed=0, options={"episode": episode})
        for (name, batch), (_, single) in zip(flat(obs), flat(one), strict=True):
            assert torch.allclose(batch[row].cpu(), single[0], atol=1e-3), (row, name)
    together.close()
    alone.close()


@pytest.mark.parametrize("env_id", ENVS)
def test_steps_are_finite_and_rows_are_reset_alone(env_id):
    env = make(env_id, ROWS, "physx_cuda")
    env.reset(seed=0)
    for _ in range(20):
        obs, reward, *_ = env.step(torch.as_tensor(env.action_space.sample()))
        assert reward.shape == (ROWS,)
        assert torch.isfinite(reward).all()
        assert all(torch.isfinite(value).all() for _, value in flat(obs))
    before = {name: value.clone() for name, value in flat(env.unwrapped.get_obs())}
    env.reset(options={"env_idx": torch.tensor([1], device=env.unwrapped.device)})
    for name, value in flat(env.unwrapped.get_obs()):
        assert torch.equal(value[0], before[name][0]), name
    env.close()
