"""A machine without any Vulkan driver: states work, images are refused with the remedy."""

import os
import subprocess
import sys

import pytest

from hab_tasks.envs import ENVS

IMAGES = ("obs_mode='depth'", "obs_mode='rgb'", "render_mode='rgb_array'")
every_env = pytest.mark.parametrize("env_id", ENVS)


@pytest.fixture
def run(tmp_path, episode_files):
    """Runs Python code in a process that finds no driver."""
    nothing = tmp_path / "none.json"
    nothing.write_text("")
    drivers = {name: str(nothing) for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")}

    def run(env_id, options, *lines):
        code = "\n".join(
            (
                "import gymnasium as gym, hab_tasks, sapien",
                f"env = gym.make({env_id!r}, episodes={str(episode_files[env_id])!r}, {options})",
                *lines,
            )
        )
        env = {**os.environ, **drivers}
        return subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)

    return run


@every_env
def test_there_is_no_driver_in_this_test(run, env_id):
    done = run(env_id, "obs_mode='state'", "sapien.render.RenderSystem(sapien.Device('cpu'))")
    assert done.returncode != 0
    assert "RuntimeError" in done.stderr


@every_env
def test_states_need_no_driver(run, env_id):
    done = run(
        env_id,
        "obs_mode='state'",
        "env.reset(seed=0)",
        "for _ in range(20): obs, *_ = env.step(env.action_space.sample())",
        "print('shape', tuple(obs.shape))",
    )
    assert done.returncode == 0, done.stderr[-2000:]
    size = sum(e.shape[0] for e in ENVS[env_id].env.skill.observation)
    assert done.stdout.splitlines()[-1] == f"shape (1, {size})"


@every_env
@pytest.mark.parametrize("options", IMAGES)
def test_images_are_refused_with_the_remedy(run, env_id, options):
    done = run(env_id, options)
    assert done.returncode != 0
    last = done.stderr.strip().splitlines()[-1]
    assert "RenderingUnavailableError" in last
    assert "apt-get install -y -t bookworm-backports mesa-vulkan-drivers" in last
