"""Without a Vulkan driver, states and depth work, and colour raises an error with a remedy."""

import os
import subprocess
import sys

import pytest

from hab_tasks.envs import ENVS

IMAGES = (
    {"obs_mode": "rgb"},
    {"render_mode": "rgb_array"},
    {"obs_mode": "depth", "render_mode": "rgb_array"},
)


@pytest.fixture
def run(tmp_path, episode_files):
    """Runs Python code in a process that finds no driver; `make(env_id, ...)` is at hand."""
    nothing = tmp_path / "none.json"
    nothing.write_text("")
    drivers = {name: str(nothing) for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")}
    files = {env_id: str(file) for env_id, file in episode_files.items()}

    def run(*lines):
        head = (
            "import gymnasium as gym, hab_tasks, sapien",
            f"files = {files!r}",
            "def make(env_id, **options):",
            "    return gym.make(env_id, episodes=files[env_id], **options)",
        )
        return subprocess.run(
            [sys.executable, "-c", "\n".join((*head, *lines))],
            env={**os.environ, **drivers},
            capture_output=True,
            text=True,
        )

    return run


def test_there_is_no_driver_in_this_test(run):
    done = run("sapien.render.RenderSystem(sapien.Device('cpu'))")
    assert done.returncode != 0
    assert "RuntimeError" in done.stderr


@pytest.mark.slow
def test_states_need_no_driver(run):
    done = run(
        "for env_id in files:",
        "    env = make(env_id, obs_mode='state')",
        "    env.reset(seed=0)",
        "    for _ in range(10): obs, *_ = env.step(env.action_space.sample())",
        "    print(env_id, *obs.shape)",
    )
    assert done.returncode == 0, done.stderr[-2000:]
    sizes = {e.id: sum(o.shape[0] for o in e.env.observation) for e in ENVS.values()}
    shown = [line for line in done.stdout.splitlines() if line.startswith("Hab")]
    assert shown == [f"{env_id} 1 {size}" for env_id, size in sizes.items()]


@pytest.mark.slow
def test_depth_needs_no_driver(run):
    done = run(
        "for env_id in files:",
        "    env = make(env_id, obs_mode='depth')",
        "    env.reset(seed=0)",
        "    for _ in range(3): obs, *_ = env.step(env.action_space.sample())",
        "    print(env_id, float(obs['sensor_data']['head']['depth'].std()))",
    )
    assert done.returncode == 0, done.stderr[-2000:]
    shown = [line.split() for line in done.stdout.splitlines() if line.startswith("Hab")]
    assert [env_id for env_id, _ in shown] == list(ENVS)
    assert all(float(spread) > 0.003 for _, spread in shown)


@pytest.mark.slow
def test_images_are_refused_with_the_remedy(run):
    done = run(
        "from hab_tasks.errors import RenderingUnavailableError",
        "for env_id in files:",
        f"    for options in {IMAGES!r}:",
        "        try:",
        "            make(env_id, **options)",
        "        except RenderingUnavailableError as error:",
        "            print(env_id, error)",
    )
    assert done.returncode == 0, done.stderr[-2000:]
    told = [line for line in done.stdout.splitlines() if line.startswith("Hab")]
    assert [line.split()[0] for line in told] == [e for e in ENVS for _ in IMAGES]
    assert all("apt-get install -y -t bookworm-backports mesa-vulkan-drivers" in t for t in told)
