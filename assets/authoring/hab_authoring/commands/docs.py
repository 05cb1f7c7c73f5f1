"""`hab-tasks docs`: the reference page of environments, and images of each and of the frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

from hab_authoring.commands.environments_page import PAGE, page
from hab_authoring.commands.options import Docs
from hab_authoring.figures.frames import Arrow, Frame, draw_frames, photo_of
from hab_tasks.engine.sensors import OBJECT_START
from hab_tasks.io.files import check_file, written_aside
from hab_tasks.registration import ENTRY_POINTS
from hab_tasks.rendering import resolve_backend


def run(options: Docs) -> int:
    """Writes the page, then the images."""
    files = [options.out / PAGE]
    if options.pictures:
        resolve_backend("auto", wants_images=True)
        files += [options.out / name for name in (*map(picture_name, ENTRY_POINTS), FRAMES_PICTURE)]
    for file in files:
        check_file(file, force=options.force)
    with written_aside(files[0]) as scratch:
        scratch.write_text(page(), encoding="utf-8")
    for file, env_id in zip(files[1:], ENTRY_POINTS, strict=False):
        with written_aside(file) as scratch:
            Image.fromarray(picture(env_id)).save(scratch)
    if options.pictures:
        draw_frames_picture(files[-1])
    for file in files:
        print(f"wrote {file}")
    return 0


FRAMES_PICTURE = "frames.png"
PICTURE_PX = 512

EPISODES = {
    "HabTidyHouse-v1": 1,
    "HabNavigate-v1": 4,
    "HabPrepareGroceries-v1": 3,
    "HabSetTable-v1": 4,
}
"""Environment -> episode of its image; the first one by default."""

FRAMES_EPISODE = 18
FRAMES_VIEW_M = (1.0, 2.3, 1.35), (0.4, 0.0, 0.6)
"""Camera position and look-at point of the frames image, in the base frame."""


def picture_name(env_id: str) -> str:
    """Returns the file name of an environment's image."""
    return f"env_{env_id}.png"


def picture(env_id: str) -> np.ndarray:
    """Returns the start of an episode, (H, 2 W, 3) uint8: the scene, and the head camera's view."""
    env = gym.make(env_id, obs_mode="rgb", render_mode="rgb_array", camera_size_px=PICTURE_PX)
    try:
        obs, _ = env.reset(seed=0, options={"episode": EPISODES.get(env_id, 0)})
        room: Any = env.render()
        views = room[0], obs["sensor_data"]["head"]["rgb"][0]
        return np.concatenate([np.asarray(v.cpu(), dtype=np.uint8) for v in views], axis=1)
    finally:
        env.close()


def draw_frames_picture(file: Path) -> None:
    """Draws base frame, end-effector frame and target at the start of an episode of Pick."""
    env = gym.make("HabPick-v1", obs_mode="state", render_mode="rgb_array")
    try:
        env.reset(seed=0, options={"episode": FRAMES_EPISODE})
        base: Any = env.unwrapped
        now = base._simulation.snapshot
        world_from_base, world_from_ee = np.eye(4), np.eye(4)
        world_from_base[:3, :3], world_from_base[:2, 3] = now.base_axes[0], now.base[0, :2]
        world_from_ee[:3, :3], world_from_ee[:3, 3] = now.ee_axes[0], now.ee_m[0]
        eye_m, at_m = ((world_from_base @ (*point, 1.0))[:3] for point in FRAMES_VIEW_M)
        target_m = now.objects_m[0, 0].astype(float)
        draw_frames(
            file,
            photo_of(base.scene.sub_scenes[0], eye_m, at_m),
            (
                Frame(name="base frame", world_from_frame=world_from_base, length_m=0.4),
                Frame(name="hand's frame", world_from_frame=world_from_ee, length_m=0.2),
            ),
            (Arrow(name=OBJECT_START.name, start_m=world_from_ee[:3, 3], end_m=target_m),),
        )
    finally:
        env.close()
