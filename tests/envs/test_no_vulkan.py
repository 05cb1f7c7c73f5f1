"""Without a Vulkan driver states work, and colour raises an error with a remedy.

Depth without a driver: `test_rays.py`.
"""

import os
import subprocess
import sys

import pytest

CODE = """
import sys, gymnasium as gym, sapien
from hab_tasks.errors import RenderingUnavailableError
try:
    sapien.render.RenderSystem(sapien.Device("cpu"))
except RuntimeError:
    print("no driver")
for env_id, file in zip(sys.argv[1::2], sys.argv[2::2]):
    env = gym.make(f"hab_tasks:{env_id}", episodes=file, obs_mode="state")
    env.reset(seed=0)
    obs, *_ = env.step(env.action_space.sample())
    print("state", bool(obs.isfinite().all()))
    depth = {"obs_mode": "depth", "render_mode": "rgb_array"}
    for options in ({"obs_mode": "rgb"}, {"render_mode": "rgb_array"}, depth):
        try:
            gym.make(f"hab_tasks:{env_id}", episodes=file, **options)
        except RenderingUnavailableError as error:
            print(error)
"""


@pytest.mark.slow
def test_states_need_no_driver_and_colour_is_refused(tmp_path, episode_files):
    nothing = tmp_path / "none.json"
    nothing.write_text("")
    drivers = dict.fromkeys(("VK_DRIVER_FILES", "VK_ICD_FILENAMES"), str(nothing))
    command = [sys.executable, "-c", CODE]
    for env_id in ("HabPick-v1", "HabSetTable-v1"):
        command += [env_id, str(episode_files[env_id])]
    done = subprocess.run(command, env=os.environ | drivers, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "no driver" in done.stdout
    assert done.stdout.count("state True") == 2
    remedy = "apt-get install -y -t bookworm-backports mesa-vulkan-drivers"
    assert done.stdout.count(remedy) == 6
