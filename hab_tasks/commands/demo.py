"""`hab-tasks demo`: runs, displays and records an episode."""

from __future__ import annotations

import io
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, redirect_stdout
from functools import partial
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, cast

import gymnasium as gym
import imageio.v2 as imageio
import numpy as np

from hab_tasks.captions import LEGEND, with_words
from hab_tasks.commands.keyboard import (
    BROWSER_KEYS,
    KEYS,
    QUIT,
    WAIT_S,
    Keyboard,
    held_keys,
    key_table,
    keys_of,
)
from hab_tasks.commands.options import Demo
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.ray_sensors import visible_bodies
from hab_tasks.engine.rollout import EndRolloutError, EnvRow, Job, Outcome, StepInfo, play_one
from hab_tasks.engine.viewpoint import LOOK_AT_M, in_world, marked_points, tips_m
from hab_tasks.episodes.source import UNLIMITED
from hab_tasks.errors import HabError, RenderingUnavailableError, UnknownNameError
from hab_tasks.geometry import apply, planar
from hab_tasks.io.files import check_file, written_aside
from hab_tasks.option_values import LARGEST_RESET_SEED, whole
from hab_tasks.registration import imported_id
from hab_tasks.rendering import resolve_backend

AGENTS, VIEWERS = ("random", "keyboard"), ("window", "web")
RANDOM_STEPS = 200
MOST_STEPS = 1_000_000
CAPTION_LINES = 5
HOLD_HZ = 10.0
"""Reports of a button that is held."""


def run(options: Demo) -> int:
    """Runs the episode; prints a line per action, then the result.

    Raises:
        HabError: Invalid options.
    """
    _check(options)
    web = options.viewer == "web"
    window = not web and _window_works()
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
        show = _Show(options.env, scene, window, video, web=web)
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
    if options.viewer not in VIEWERS:
        raise UnknownNameError("viewer", options.viewer, VIEWERS)
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
    if show.web is None:
        print(key_table(keyboard.meanings), flush=True)
        keys = keys_of(sys.stdin, show.refresh)
    else:
        keys = held_keys(show.web.drive(keyboard.meanings), show.refresh)
    for name, share in keys:
        if name == QUIT:
            return
        action = keyboard.action(name, share)
        if action is None:
            print(f"  {name!r} has no function in this control mode")
            continue
        yield action


class _Show:
    """Output to the console, a window or browser, and a video; has the last step."""

    seen: StepInfo

    def __init__(
        self, env_id: str, scene: HabEnv, window: bool, video: Path | None, *, web: bool
    ) -> None:
        self._env_id, self.scene, self._window, self._video = env_id, scene, window, video
        self.web = _Web(scene) if web else None
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
        if self.web is not None:
            self.web.start()
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
        if self.web is not None:
            self.web.show([self._task, *_stages(seen.info), _line(seen)])
        if self._window or self.web is not None:
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
        """Finishes the video and the page."""
        if self.web is not None:
            self.web.close()
        if self._writer is not None:
            self._writer.close()


class _Web:
    """A page with the scene, on which buttons and keys drive the robot."""

    def __init__(self, env: HabEnv) -> None:
        from hab_tasks.web_scene import WebScene, viser  # needs viser: said before the episode

        self._env, self._make = env, WebScene
        self._pressed: SimpleQueue[str] = SimpleQueue()
        with redirect_stdout(io.StringIO()):  # viser's own lines, of a server for everyone
            self._server = viser.ViserServer(host="127.0.0.1", verbose=False)

    def start(self) -> None:
        """Adds the scene, and waits until the page is open."""
        env = self._env
        self._bodies = [one for one in visible_bodies(env.simulation, env.agent) if one.visuals]
        bodies = [(body.name, body.visuals) for body in self._bodies]
        colors = [color for color, _ in marked_points(env.simulation)]
        base = np.array(env.simulation.snapshot.base[0], dtype=float)
        camera = self._server.initial_camera
        camera.position, camera.look_at = (
            in_world(0, base),
            apply(planar(*base), np.array(LOOK_AT_M)),
        )
        self._scene = self._make(self._server, bodies, colors)
        self._text = self._server.gui.add_markdown("")
        print(f"open http://127.0.0.1:{self._server.get_port()}/ (Ctrl-C ends)", flush=True)
        while not self._server.get_clients():
            time.sleep(WAIT_S)

    def drive(self, functions: Mapping[str, str]) -> Callable[[float], Iterable[str]]:
        """Adds a button and a key for each function; returns how to read what is pressed."""
        gui = self._server.gui
        for name, words in functions.items():
            key = BROWSER_KEYS.get(name)
            press = partial(self._press, name)
            button = gui.add_button(words if key is None else f"{key}: {words}")
            button.on_click(press)
            if name in KEYS:
                button.on_hold(press, callback_hz=HOLD_HZ)
            if key is not None:
                gui.add_command(words, hotkey=cast(Any, key)).on_trigger(press)
        return self._read

    def _press(self, name: str, _: object) -> None:
        self._pressed.put(name)

    def _read(self, wait_s: float) -> Iterable[str]:
        try:
            return (self._pressed.get(timeout=wait_s),)
        except Empty:
            return ()

    def show(self, lines: Iterable[str]) -> None:
        """Shows the present state, with lines of text."""
        simulation = self._env.simulation
        poses = [body.entity.pose for body in self._bodies]
        self._scene.show(
            np.array(simulation.snapshot.base[0], dtype=float),
            np.array([(*pose.p, *pose.q) for pose in poses], dtype=float),
            tips_m(simulation),
            simulation.contact_points_m(),
        )
        self._text.content = "\n\n".join(lines)

    def close(self) -> None:
        """Ends the server."""
        with redirect_stdout(io.StringIO()):
            self._server.stop()


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
