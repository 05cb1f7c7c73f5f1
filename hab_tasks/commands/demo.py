"""`hab-tasks demo`: runs, displays and records an episode."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import imageio.v2 as imageio
import numpy as np

from hab_tasks.captions import LEGEND, with_words
from hab_tasks.commands.keyboard import QUIT, Keyboard, keys_of
from hab_tasks.commands.options import Demo
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.rollout import EndRolloutError, EnvRow, Job, Outcome, StepInfo, play_one
from hab_tasks.episodes.source import UNLIMITED
from hab_tasks.errors import HabError, RenderingUnavailableError, UnknownNameError
from hab_tasks.io.files import check_file, written_aside
from hab_tasks.option_values import LARGEST_RESET_SEED, whole
from hab_tasks.registration import imported_id
from hab_tasks.rendering import resolve_backend

AGENTS = ("random", "keyboard")
RANDOM_STEPS = 200
MOST_STEPS = 1_000_000
CAPTION_LINES = 5


def run(options: Demo) -> int:
    """Runs the episode; prints a line per action, then the result.

    Raises:
        HabError: Invalid options.
    """
    _check(options)
    window = _window_works()
    env = gym.make(
        options.env,
        obs_mode="none",
        render_mode="human" if window else "rgb_array" if options.out else None,
        scene_dataset=options.scene_dataset,
        objects=options.objects,
        num_episodes=max(50, options.episode + 1),
    )
    scene = cast(HabEnv, env.unwrapped)
    with ExitStack() as ends:
        ends.callback(env.close)
        video = None if options.out is None else ends.enter_context(written_aside(options.out))
        show = _Show(options.env, scene, window, video)
        ends.callback(show.close)
        end = _play(options, env, show)
    _tell(show.seen, end)
    if options.out is not None:
        print(f"{'video':<9} {options.out}")
    return 0


def _check(options: Demo) -> None:
    imported_id(options.env)
    if options.agent not in AGENTS:
        raise UnknownNameError("agent", options.agent, AGENTS)
    if options.steps is not None:
        whole("--steps", options.steps, 1, MOST_STEPS)
    whole("--episode", options.episode, 0, UNLIMITED - 1)
    whole("--seed", options.seed, 0, LARGEST_RESET_SEED)
    if options.out is not None:
        if options.out.suffix != ".mp4":
            raise HabError(f"--out {options.out}: a video must end in .mp4.")
        check_file(options.out, force=options.force)
        resolve_backend("auto", wants_images=True)


def _play(options: Demo, env: gym.Env[Any, Any], show: _Show) -> str:
    """Acts until the episode ends, the actions are used up, or the user quits; returns which."""
    limit = options.steps or (RANDOM_STEPS if options.agent == "random" else None)
    actions = _random(env, options.seed) if options.agent == "random" else _typed(show)

    def restart(env: gym.Env[Any, Any], job: Job) -> tuple[Any, dict[str, Any]]:
        return env.reset(seed=options.seed, options={"episode": job.index})

    row = EnvRow(env, [show], restart=restart)
    try:
        outcome = play_one(row, _Player(islice(actions, limit), show), Job(options.episode))
    except KeyboardInterrupt:
        if row.job is None:
            raise  # there is nothing to tell
        return "interrupted"
    if outcome is None:
        return "stopped"
    return "the episode is over" if outcome.success or outcome.failure else "time is over"


class _Player:
    """Executes actions until there are no more."""

    def __init__(self, actions: Iterator[Any], show: _Show) -> None:
        self._actions, self._show = actions, show

    def reset(self, mask: Any, seeds: Any) -> None:
        """Does nothing: it plays one episode."""

    def act(self, obs: Any) -> Any:
        """Returns the next action."""
        action = None if self._show.closed else next(self._actions, None)
        if action is None:
            raise EndRolloutError
        return action


def _random(env: gym.Env[Any, Any], seed: int) -> Iterator[Any]:
    env.action_space.seed(seed)
    while True:
        yield env.action_space.sample()


def _typed(show: _Show) -> Iterator[Any]:
    """Yields the action of each key, repeated while it is held."""
    scene = show.scene
    keyboard = Keyboard(scene.agent.controller, bool(scene.measures.holding_target))
    print(keyboard.table, flush=True)
    for name, share in keys_of(sys.stdin, show.refresh):
        if name == QUIT:
            return
        action = keyboard.action(name, share)
        if action is None:
            print(f"  {name!r} has no function in this control mode")
            continue
        yield action


class _Show:
    """Output to the console, and to a window, a video, both, or neither; has the last step."""

    seen: StepInfo

    def __init__(self, env_id: str, scene: HabEnv, window: bool, video: Path | None) -> None:
        self._env_id, self.scene, self._window, self._video = env_id, scene, window, video
        self._viewer: Any = None
        self._writer: Any = None
        self._seen_from: Any = None
        self._due_s, self._task = 0.0, ""

    @property
    def closed(self) -> bool:
        """Whether the user has closed the window."""
        return self._viewer is not None and self._viewer.closed

    def reset(self, job: Job, seen: StepInfo) -> None:
        """Tells the task, which is also the caption of every frame, and shows the start."""
        task = self.scene.instruction[0]
        print(f"{self._env_id}, episode {self.scene.episode[0].id}\n{task}")
        self._task = f"{task} ({LEGEND})"
        self._draw(seen)

    def step(self, seen: StepInfo) -> None:
        """Tells and shows a step."""
        print(_line(seen))
        self._draw(seen)

    def end(self, outcome: Outcome | None) -> None:
        """The last frame is there already."""

    def _draw(self, seen: StepInfo) -> None:
        self.seen = seen
        if self._video is not None:
            self._writer = self._writer or _writer(self._video)
            frame = np.asarray(self.scene.render_rgb_array()[0].cpu(), dtype=np.uint8)
            words = [self._task, *_stages(seen.info)]
            self._writer.append_data(with_words(frame, words, CAPTION_LINES))
        if self._window:
            self.refresh()
            time.sleep(max(0.0, self._due_s - time.monotonic()))
            self._due_s = time.monotonic() + 1.0 / CONTROL_HZ

    def refresh(self) -> None:
        """Renders the window; its camera follows the robot."""
        if not self._window or self.closed:
            return
        self._viewer = self.scene.render_human()
        camera = self.scene.scene.human_render_cameras["render_camera"].camera
        position = camera.get_global_pose().sp.p
        if self._seen_from is None or not np.allclose(position, self._seen_from, atol=1e-3):
            self.scene.render_rgb_array()  # moves the camera to a clear view of the robot
            pose = camera.get_global_pose().sp
            self._viewer.set_camera_pose(pose)
            self._seen_from = pose.p

    def close(self) -> None:
        """Finishes the video."""
        if self._writer is not None:
            self._writer.close()


def _writer(file: Path) -> Any:
    return imageio.get_writer(
        file,
        format="FFMPEG",  # pyright: ignore[reportArgumentType]  # the stub lacks plugin names
        fps=CONTROL_HZ,
        macro_block_size=2,
    )


def _window_works() -> bool:
    """Returns whether a window can be opened; prints the reason if not."""
    named = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not named:
        print("no display, so no window; use --out FILE.mp4 to write a video")
        return False
    try:
        resolve_backend("auto", wants_images=True)
    except RenderingUnavailableError as error:
        print(f"no window can be opened. {error}")
        return False
    return True


def _line(seen: StepInfo) -> str:
    """Returns a step's reward and measures; of the flags, only those that are true."""
    said = []
    for name, value in seen.info["measures"].items():
        number = value.item()
        if isinstance(number, bool):
            said += [name] if number else []
        else:
            said.append(f"{name} {number:.3f}")
    return f"{seen.step:>4}  reward {seen.reward:+.3f}  {'  '.join(said)}"


def _tell(seen: StepInfo, end: str) -> None:
    """Prints the result of the episode."""
    info = seen.info
    failures = [name for name, failed in info.get("failures", {}).items() if failed.item()]
    rows = {
        "success": "yes" if info.get("success") else "no",
        "end": ", ".join([f"{end} after {seen.step} actions", *failures]),
        "return": f"{seen.episode_return:.3f}",
    }
    for words in _stages(info):
        rows["stages"] = words.removeprefix("stages: ")
    for name, words in rows.items():
        print(f"{name:<9} {words}")


def _stages(info: Mapping[str, Any]) -> list[str]:
    """Returns a line on the stages of a task; empty for a skill."""
    stages = info.get("stages", {})
    reached = [name for name, value in stages.items() if value.item()]
    line = f"stages: {len(reached)} of {len(stages)} {' '.join(reached)}".strip()
    return [line] if stages else []
