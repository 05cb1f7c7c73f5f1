"""Suite regressions: settled claims about 10 to 100 objects, two processes and memory."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper

from hab_eval.bench.hab_env import HabEnvFactory, actions_of, control_of, motion_of
from hab_eval.bench.process import BenchEnv, Memory, RemoteEnv, StepTiming, read_memory
from hab_eval.bench.report import BenchRow, bound_row, make_row
from hab_eval.bench.suite import PICK, TIDY_HOUSE, BenchOptions, Suite, WriteLine
from hab_eval.errors import BenchError
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes
from hab_tasks.episodes.placing import Placer
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.spots import Spot
from hab_tasks.geometry import Pose7
from hab_tasks.io.threads import use_one_thread
from hab_tasks.object_names import TRAIN_OBJECTS
from hab_tasks.world.scenes.floor import CELL_M
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.spec import Receptacle

COUNTS = (10, 30, 100)
"""Numbers of movable objects in the scene, including the target objects."""

GROWTH_BOUND_PERCENT = 10.0
SHARE_BOUND = 0.4

FEW, MANY = 1, 3
"""Sizes of the two vector environments whose memory is read."""

PROCESS_BOUND_MB = 700.0
FURTHER_BOUND_MB = 350.0


def run_regressions(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures objects, processes and memory in each scene."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        for part in (run_objects, run_processes, run_memory):
            rows += part(options, scene, write_line)
    return rows


def run_objects(options: BenchOptions, scene: str, write_line: WriteLine) -> list[BenchRow]:
    """Measures HabTidyHouse-v1 with each of `COUNTS` objects."""
    request = EpisodeRequest(
        env_id=TIDY_HOUSE,
        scene_dataset=str(options.scene_dataset),
        objects=None if options.objects is None else str(options.objects),
        scene=scene,
    )
    episodes = episodes_by_object_count(request, COUNTS)
    factory = HabEnvFactory.of(options, TIDY_HOUSE, (scene,), episodes=episodes)
    with closing(RemoteEnv(factory, {})) as env:
        write_line(f"objects, scene {scene}: the environment is ready")
        timings = time_objects(options, env, write_line)
    return object_rows(("objects", scene, TIDY_HOUSE), timings)


def time_objects(
    options: BenchOptions, env: BenchEnv, write_line: WriteLine
) -> dict[int, list[StepTiming]]:
    """Cycles through the episodes, one per number of objects; the first cycle is warm-up."""
    control = control_of(TIDY_HOUSE)
    timings: dict[int, list[StepTiming]] = {count: [] for count in COUNTS}
    for repeat in range(options.repeats + 1):
        motion = motion_of(control, options.step_count, max(0, repeat - 1))
        for count in COUNTS:
            timings[count].append(env.run_steps(motion))
            env.soft_reset()
        if repeat:
            shown = ", ".join(f"{timings[count][-1].outside_ms:.3f} ({count})" for count in COUNTS)
            write_line(f"repeat {repeat} of {options.repeats}: outside physics {shown} ms/step")
    return {count: found[1:] for count, found in timings.items()}


def object_rows(
    name: tuple[str, str, str], timings: Mapping[int, Sequence[StepTiming]]
) -> list[BenchRow]:
    """Returns the rows of timings: time outside the engine, physics share and growth."""
    few, *_, many = sorted(timings)
    outside = {count: [t.outside_ms for t in found] for count, found in timings.items()}
    rows = []
    for count in sorted(timings):
        share = [timing.physics_share for timing in timings[count]]
        time_name = (*name, f"{count}_objects_outside_physics")
        share_name = (*name, f"{count}_objects_physics_share")
        reference = f"{few} objects"
        rows += [
            make_row(time_name, outside[count], outside[few], unit="ms/step", reference=reference),
            bound_row(share_name, share, SHARE_BOUND, unit="1"),
        ]
    # Per repeat, because the machine's speed varies between repeats.
    growth = [100.0 * (b / a - 1.0) for a, b in zip(outside[few], outside[many], strict=True)]
    variant = f"growth_{few}_to_{many}"
    return [*rows, bound_row((*name, variant), growth, GROWTH_BOUND_PERCENT, unit="%")]


def run_processes(options: BenchOptions, scene: str, write_line: WriteLine) -> list[BenchRow]:
    """Compares HabPick-v1 in two processes of a vector environment with one."""
    count = options.step_count
    pairs = []
    with (
        closing(VectorEnv(options, PICK, scene, 1)) as one,
        closing(VectorEnv(options, PICK, scene, 2)) as two,
    ):
        write_line(f"processes, scene {scene}: three processes are ready")
        for vector in (one, two):  # warm-up
            vector.run_steps(count, 0)
        for repeat in range(options.repeats):
            pairs.append((one.run_steps(count, repeat), two.run_steps(count, repeat)))
            shown = "one process {:.1f} steps/s, two processes {:.1f}".format(*pairs[-1])
            write_line(f"repeat {repeat + 1} of {options.repeats}: {shown}")
    ones, twos = zip(*pairs, strict=True)
    name = ("processes", scene, PICK, "two_in_vector_env")
    return [make_row(name, twos, ones, unit="steps/s", reference="one process")]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Memory of a vector environment.

    Attributes:
        parent: Memory of the process that steps the environments.
        workers: Memory of each environment's process.
    """

    parent: Memory
    workers: tuple[Memory, ...]

    @property
    def pss_mb(self) -> float:
        """Total memory of all processes."""
        return self.parent.pss_mb + sum(worker.pss_mb for worker in self.workers)


def run_memory(options: BenchOptions, scene: str, write_line: WriteLine) -> list[BenchRow]:
    """Reads the memory of HabTidyHouse-v1 in vector environments of sizes `FEW` and `MANY`.

    Readings alternate, each from new processes after reset and steps.
    """
    VectorEnv(options, TIDY_HOUSE, scene, FEW).close()  # warm-up: the parent's imports stay loaded
    pairs = []
    for repeat in range(options.repeats):
        few, many = (_reading(options, scene, count, repeat) for count in (FEW, MANY))
        pairs.append((few, many))
        write_line(
            f"repeat {repeat + 1} of {options.repeats}: resident {few.workers[0].rss_mb:.0f} MB"
            f", each additional process {further_mb(few, many):.0f} MB"
        )
    return memory_rows(("memory", scene, TIDY_HOUSE), pairs)


def _reading(options: BenchOptions, scene: str, count: int, seed: int) -> Reading:
    with closing(VectorEnv(options, TIDY_HOUSE, scene, count)) as vector:
        vector.run_steps(options.step_count, seed)
        gc.collect()
        workers = tuple(read_memory(pid) for pid in vector.pids())
        return Reading(parent=read_memory(os.getpid()), workers=workers)


def further_mb(few: Reading, many: Reading) -> float:
    """Returns the total memory per additional environment [MB]."""
    return (many.pss_mb - few.pss_mb) / (len(many.workers) - len(few.workers))


def memory_rows(
    name: tuple[str, str, str], pairs: Sequence[tuple[Reading, Reading]]
) -> list[BenchRow]:
    """Returns the rows of readings: one process, and each additional one."""
    one = [few.workers[0] for few, _ in pairs]
    resident = [memory.rss_mb for memory in one]
    private = [sum(w.uss_mb for w in many.workers) / len(many.workers) for _, many in pairs]
    further = [further_mb(few, many) for few, many in pairs]

    def beside(variant: str, values: Sequence[float]) -> BenchRow:
        return make_row((*name, variant), values, resident, unit="MB", reference="one_env_rss")

    def bound(variant: str, values: Sequence[float], bound_mb: float) -> BenchRow:
        return bound_row((*name, variant), values, bound_mb, unit="MB")

    return [
        bound("one_env_rss", resident, PROCESS_BOUND_MB),
        beside("one_env_pss", [memory.pss_mb for memory in one]),
        beside("one_env_uss", [memory.uss_mb for memory in one]),
        bound("further_env_pss", further, FURTHER_BOUND_MB),
        bound("further_env_uss", private, FURTHER_BOUND_MB),
    ]


class VectorEnv:
    """Copies of an environment in one AsyncVectorEnv, with state observations."""

    def __init__(self, options: BenchOptions, env_id: str, scene: str, count: int) -> None:
        """Starts `count` processes."""
        self._env_id = env_id
        factory, self._control, self._episode = _factory(options, env_id, scene)
        with _reporting_lost_processes():
            self._env = AsyncVectorEnv(
                [partial(_make, factory)] * count,
                context="spawn",  # threads do not survive a fork
                autoreset_mode=AutoresetMode.DISABLED,
            )

    def run_steps(self, count: int, seed: int) -> float:
        """Resets all environments and steps each `count` times; returns their total steps/s."""
        size = self._env.num_envs
        motion = motion_of(self._control, count, seed)
        actions = actions_of(self._env_id, motion, self._episode).numpy()
        together = np.repeat(actions[:, None], size, axis=1)
        with _reporting_lost_processes():
            self._env.reset(seed=self._episode.seed, options={"episode": self._episode})
            started = time.perf_counter()
            for action in together:
                self._env.step(action)
            return size * count / (time.perf_counter() - started)

    def pids(self) -> tuple[int, ...]:
        """Returns the process ids of the environments."""
        return tuple(int(process.pid or 0) for process in self._env.processes)

    def close(self) -> None:
        """Ends the processes."""
        self._env.close()


def _factory(options: BenchOptions, env_id: str, scene: str) -> tuple[Any, str, Any]:
    """Returns the factory of an environment, its control mode and its episode."""
    factory = HabEnvFactory.of(options, env_id, (scene,), obs_mode="state")
    return factory, control_of(env_id), factory.episodes_in(scene)[0]


@contextmanager
def _reporting_lost_processes() -> Iterator[None]:
    """Reports the end of a process, of which Gymnasium only reports a closed pipe."""
    try:
        yield
    except (EOFError, ConnectionError) as error:
        raise BenchError("A process of the vector environment ended; see above.") from error


def _make(factory: Any) -> gym.Env[Any, Any]:
    """Creates one environment in its process, with Gymnasium's single-environment interface."""
    use_one_thread()
    return CPUGymWrapper(factory.make_env())


SUITE = Suite(name="regressions", run=run_regressions, steps=200)


PATCH_CELLS = 6
"""Edge length of the square floor patches for additional objects [cells]."""

AWAY_M = 1.5
"""Minimum distance of a patch's center from the robot."""

SPARE = 1.2
"""Placed objects / required objects; those that do not stay in place are left out."""

FIRST_NUMBER = 1000
"""First instance number of additional objects, larger than any in generated episodes."""


def episodes_by_object_count(
    request: EpisodeRequest, counts: Sequence[int], seed: int = 0
) -> tuple[Episode, ...]:
    """Returns copies of the first generated episode with different numbers of movable objects.

    The target objects come first, then the generated clutter, then additional objects on the floor
    far from the robot. The objects of each episode are a subset of those of the larger ones.

    Args:
        request: Episode set; its scene must be given.
        counts: Numbers of movable objects, including the target objects.
        seed: Seed of the placement of additional objects.

    Raises:
        BenchError: The floor has too little room.
    """
    assert request.scene is not None
    (episode,) = load_episodes(request, 1).episodes
    spec = load_scene(resolve_dataset(request.scene_dataset), request.scene)
    sandbox = PlacementSandbox(spec, load_objects(request.objects))
    missing = max(0, max(counts) - len(episode.objects))
    further = _on_floor(sandbox, episode, round(SPARE * missing), np.random.default_rng(seed))
    if len(further) < missing:
        raise BenchError(
            f"Floor of {request.scene}: room for {len(further)} of {missing} additional objects. "
            "Use another --scene."
        )
    targets = {target.object: episode.objects[target.object] for target in episode.targets}
    objects = list({**targets, **episode.objects, **further}.items())
    return tuple(
        replace(episode, id=f"{episode.id}/{count}", objects=dict(objects[:count]))
        for count in counts
    )


def _on_floor(
    sandbox: PlacementSandbox, episode: Episode, count: int, rng: np.random.Generator
) -> dict[str, Pose7]:
    """Places `count` additional objects; returns name -> pose of those that stay in place."""
    templates = [TRAIN_OBJECTS[number % len(TRAIN_OBJECTS)] for number in range(count)]
    names = [f"{template}_:{FIRST_NUMBER + number}" for number, template in enumerate(templates)]
    sandbox.show((*episode.objects, *names))
    for name, pose in episode.objects.items():
        sandbox.place(name, pose)
    patches = floor_patches(sandbox, np.array(episode.robot.base[:2]))
    placer = Placer(sandbox, rng)
    for name in names:
        placer.put(name, patches)
    settled = placer.settle()
    return {name: settled[name] for name in names if name in settled}


def floor_patches(sandbox: PlacementSandbox, robot_m: np.ndarray) -> list[Spot]:
    """Returns disjoint patches of free floor at least `AWAY_M` from the robot's position (2,)."""
    free = sandbox.floor().cells_by_distance(robot_m, 0.0, AWAY_M)
    cells = np.round((free - free.min(axis=0)) / CELL_M).astype(int) if len(free) else free
    middles = free[(cells % PATCH_CELLS == 0).all(axis=1)]
    half_m = PATCH_CELLS * CELL_M / 2
    return [
        Spot(
            receptacle=Receptacle(
                name=f"floor_{number}",
                body="floor",
                body_from_box=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
                half_size_m=(half_m, half_m, half_m),
                up=(0.0, 0.0, 1.0),
            ),
            center_m=np.array([x, y, 0.0]),
            axes=np.eye(3)[:, :2],
            half_m=np.array([half_m, half_m]),
            height_m=2 * half_m,
            joints={},
        )
        for number, (x, y) in enumerate(middles)
    ]
