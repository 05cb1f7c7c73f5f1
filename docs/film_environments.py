"""Films an episode of each environment for the page of environments, from submissions."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import imageio_ffmpeg
from hab_authoring.commands.docs import video_name
from hab_eval.records.leaderboard import default_submissions
from hab_eval.records.results import read_record

OUT = Path(__file__).parent
WIDTH_PX, QUALITY = 960, 32

SUBMISSIONS = {
    "HabPick-v1": "pick_blind-pick-apartment-seed2026",
    "HabPlace-v1": "place_blind-place-apartment-seed2026",
    "HabOpenFridge-v1": "open_fridge_blind-open_fridge-apartment-seed2026",
    "HabCloseFridge-v1": "close_fridge_blind-close_fridge-apartment-seed2026",
    "HabOpenDrawer-v1": "open_drawer_blind-open_drawer-apartment-seed2026",
    "HabCloseDrawer-v1": "close_drawer_blind-close_drawer-apartment-seed2026",
    "HabNavigate-v1": "spa_priv-navigate-apartment-seed2026",
    "HabTidyHouse-v1": "tp_spa_priv-tidy_house-apartment-seed5",
    "HabPrepareGroceries-v1": "tp_spa_priv-prepare_groceries-apartment-seed5",
    "HabSetTable-v1": "tp_srl-set_table-apartment-seed81-options0fe08328",
}
"""Environment -> submission whose first success is filmed."""

LONG_STEPS, FASTER = 500, 8
"""Longer episodes are shown eight times as fast."""


def film(env_id: str, submission: str) -> None:
    """Repeats the first success of a submission, and writes its video, made small."""
    record = read_record(default_submissions() / f"{submission}.json")
    index = next(i for i, episode in enumerate(record.episodes) if episode.success)
    speed = FASTER if record.episodes[index].steps > LONG_STEPS else 1
    target = OUT / video_name(env_id)
    target.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        command = ["film", submission, "--episode", str(index), "--out", scratch]
        # Returns may differ in their last digits; a video of another outcome is not written.
        subprocess.run([sys.executable, "-m", "hab_eval", *command], check=False)
        (source,) = Path(scratch).glob("*/*.mp4")
        filters = f"setpts=PTS/{speed},fps=15,scale={WIDTH_PX}:-2"
        options = ["-vf", filters, "-crf", str(QUALITY), "-preset", "veryslow", "-an"]
        options += ["-pix_fmt", "yuv420p", "-movflags", "+faststart", "-y"]
        ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
        subprocess.run([ffmpeg, "-v", "error", "-i", source, *options, target], check=True)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or SUBMISSIONS:
        film(chosen, SUBMISSIONS[chosen])
