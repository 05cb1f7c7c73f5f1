"""Sources of episodes: a file, the files included in the package, the cache, or generation.

An episode depends only on (dataset, split, seed, index): requests for 50 and for 500 episodes have
the same first 50, and repeated requests are equal.
"""

from __future__ import annotations

import logging
import os
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import asdict, astuple, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from hab_tasks.episodes.generators import base
from hab_tasks.episodes.generators.base import Made, Objects
from hab_tasks.episodes.generators.crowded import crowded
from hab_tasks.episodes.generators.rearrange import Rearrange
from hab_tasks.episodes.made_files import SharedEpisodes
from hab_tasks.episodes.schema import (
    SCHEMA,
    Episode,
    EpisodeRequest,
    EpisodeSet,
    check_made_from,
    made_from,
    read_episodes,
    stable_hash,
    write_episodes,
)
from hab_tasks.episodes.spanning import spanned
from hab_tasks.errors import EpisodeError, FileError, OptionError, UnknownNameError
from hab_tasks.io.cache import find, read_cached, write_cached
from hab_tasks.io.executors import Executor, LocalExecutor, Task
from hab_tasks.object_names import TRAIN_OBJECTS, UNSEEN_OBJECTS
from hab_tasks.receptacles import UNSEEN_RECEPTACLES
from hab_tasks.registration import TASKS, class_of, imported_id
from hab_tasks.robots.spec import robot_of
from hab_tasks.world.scenes.habitat.dataset import embedded_dataset, resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.handle_bars import AHEAD_M, with_bars
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.spec import SceneSpec

UNLIMITED = 1_000_000
NOVELTIES = ("objects", "receptacles")
Progress = Callable[[int, int], None]
Record = Callable[[int, Made], None]


class EpisodeSource:
    """The episodes of a request, by index.

    Attributes:
        dataset: The scene dataset.
        objects: Object name -> template of the movable objects.
        file: The episode file; None where episodes are generated.
        split: The resolved split.
        available: Number of episodes.
        made_from: Provenance of the episodes.
        rejections: Reason -> number of candidates rejected by this process.
        making: Entry of the cache in which processes share the episodes of a set in the making.
        saved: Number of episodes of the set in the cache.
    """

    _make_generator: Callable[..., base.Generator]

    def __init__(self, request: EpisodeRequest, folder: Path | None = None) -> None:
        """Reads the data and episodes of a request; processes share new ones in `folder`."""
        if request.novel not in (None, *NOVELTIES):
            raise UnknownNameError("novelty", request.novel, NOVELTIES)
        self.env_id = imported_id(request.env_id)
        task = TASKS.get(self.env_id)
        starts = Rearrange if task else class_of(self.env_id).skill.starts
        self._make_generator = partial(Rearrange, task) if task else starts
        self.file = None if request.file is None else Path(request.file)
        given = None if self.file is None else read_episodes(self.file, self.env_id, request.robot)
        self.dataset, self.scene_id = resolve_dataset(request.scene_dataset), request.scene
        self.split = self.dataset.resolve_split(request.split, request.scene)
        if given is not None:
            self.dataset.check_made_for(given.scene_dataset, str(self.file))
            for episode in given.episodes:
                self.dataset.scene_file(episode.scene_id)
        self.objects = load_objects(request.objects)
        self.made_from = made_from(self.dataset, self.objects, starts.version)
        if given is not None:
            check_made_from(str(self.file), self.dataset.name, given.made_from, self.made_from)
        self._request, self._folder = request, folder
        self.seed, self.novel = request.seed, request.novel
        if request.clutter and given is not None:
            raise OptionError.of_value("clutter", request.clutter, "0 with an episode file")
        self._variant = variant_of(request)
        self._by_friction = robot_of(request.robot).fingers is not None
        self.available = UNLIMITED
        self.rejections: Counter[str] = Counter()
        self._generator: base.Generator | None = None
        self._plain: EpisodeSource | None = None
        self._episodes: dict[int, Episode] = {}
        self._included: dict[int, Episode] = {}
        self._scenes: dict[str, SceneSpec] = {}
        self._set_read, self.saved = (0, 0), 0
        if given is None:
            self._take_generated()
        else:
            self._take(given)
            self.split, self.available, self.made_from = given.split, len(given), given.made_from

    def _take_generated(self) -> None:
        scope = "-".join(part for part in (self.split, self.scene_id) if part) + self._variant
        dataset, kind = self.dataset, self.made_from.objects
        self._name = f"{self.env_id}.{dataset.name}.{kind}.{scope}.{self.seed}.json.gz"
        # The fingerprint of a task covers starts and goals of its objects, not its instruction.
        task = TASKS.get(self.env_id)
        spec = (task and (task.targets, task.starts_open, task.clutter, task.clutter_on)) or ()
        bars = (AHEAD_M,) if self._by_friction else ()
        key = stable_hash(*map(str, (SCHEMA, *astuple(self.made_from), *spec, *bars)))
        self._task = stable_hash(*map(str, spec)) if spec else None
        self._cached = f"episodes/{key:08x}/{self._name}"
        self.making, self._key = f"{self._cached}.making", stable_hash(self._cached)
        shipped = embedded_dataset()
        embedded = shipped.parent / "episodes" / self._name
        if dataset.root == shipped.resolve() and embedded.exists():
            self._take(read_episodes(embedded))
            self._included = dict(self._episodes)
        self._read_set()

    def holds(self, count: int) -> bool:
        """Returns whether the first `count` episodes were read."""
        return all(index in self._episodes for index in range(count))

    @property
    def given(self) -> tuple[Episode, ...]:
        """The episodes of the file; empty if episodes are generated."""
        return () if self.file is None else tuple(self._episodes.values())

    def configuration(self) -> dict[str, str | int | None]:
        """Returns all that generated episodes depend on, besides their index."""
        return {
            "env": self.env_id,
            "scene_dataset": self.dataset.name,
            "split": self.split,
            "scene": self.scene_id,
            "seed": self.seed,
            "novel": self.novel,
            **asdict(self.made_from),
            "task": self._task,
        }

    def get(self, index: int) -> Episode:
        """Returns the episode of an index, generating it if necessary.

        Raises:
            EpisodeError: The source is a file with fewer episodes.
            GenerationError: No valid start state was found.
        """
        if not 0 <= index < self.available:
            raise EpisodeError(f"Episode {index}: valid indices are 0 to {self.available - 1}.")
        if not self.has(index):
            made = self.make(index)
            if self._folder is not None:
                with suppress(FileError):  # without room, others generate it themselves
                    self.shared_in(self._folder).publish(index, made)
            self._keep(index, made)
        return self._episodes[index]

    def is_there(self, index: int) -> bool:
        """Returns whether an episode was read, or processes that make the set have made it."""
        folder = None if index in self._episodes else find(self.making)
        return index in self._episodes or (folder is not None and self.shared_in(folder).has(index))

    def has(self, index: int) -> bool:
        """Returns whether there is an episode; takes those that other processes have made."""
        if index in self._episodes:
            return True
        folders = self._folder, find(self.making)
        found = (self.shared_in(folder).find(index) for folder in folders if folder is not None)
        made = next((one for one in found if one is not None), None)
        if made is None:
            self._read_set()
            return index in self._episodes
        self._keep(index, made)
        return True

    def shared_in(self, folder: Path) -> SharedEpisodes:
        """Returns the episodes that processes share in a folder."""
        return SharedEpisodes(folder, self._key)

    def _read_set(self) -> None:
        """Reads the set in the cache if it has changed; it may be damaged, or removed meanwhile."""
        with suppress(OSError):
            found = os.stat(find(self._cached) or "")
            before, self._set_read = self._set_read, (found.st_ino, found.st_mtime_ns)
            if self._set_read != before:
                kept = read_cached(self._cached, read_episodes)
                # The cache may have more episodes than the package, which takes precedence.
                if kept is not None and len(kept) > len(self._included):
                    self.saved = len(kept)
                    self._take(kept)
                    self._episodes |= self._included

    def restore(self, made: Mapping[int, Made], count: int) -> None:
        """Takes those of the first `count` episodes that an earlier process generated."""
        for index in sorted(made):
            if index < count and index not in self._episodes:
                self._keep(index, made[index])

    def prepare(
        self,
        count: int,
        workers: int | Executor = 1,
        progress: Progress | None = None,
        record: Record | None = None,
    ) -> bool:
        """Generates the missing ones of the first `count` episodes.

        Args:
            count: Number of episodes.
            workers: Number of processes, or an executor; does not change the episodes.
            progress: Called with (episodes ready, `count`) after each one.
            record: Called with the index of each generated episode and what was made.

        Returns:
            Whether any were missing.

        Raises:
            EpisodeError: The source is a file with fewer episodes.
        """
        if self.available < count:
            self.get(self.available)
        missing = [index for index in range(count) if not self.has(index)]
        ready = count - len(missing)
        executor = LocalExecutor(workers) if isinstance(workers, int) else workers
        with closing(self._made(missing, executor)) as results:
            for index, made in results:
                if record is not None:
                    record(index, made)
                self._keep(index, made)
                ready += 1
                if progress is not None:
                    progress(ready, count)
        if progress is not None and not missing:
            progress(count, count)
        return bool(missing)

    def _made(
        self, missing: list[int], executor: Executor
    ) -> Generator[tuple[int, Made], None, None]:
        """Yields the missing episodes with their indices, generated here or in workers."""
        if executor.in_process(len(missing)):
            for index in missing:
                yield index, self.make(index)
            return
        task = Task(start=_start_worker, arguments=(self._request,), name="Episode {}".format)
        with closing(executor.run(task, missing)) as results:
            for number, made in results:
                yield missing[number], made

    def scene(self, scene_id: str) -> SceneSpec:
        """Returns a layout, for a grasp by friction with a bar on every handle; cached."""
        if scene_id not in self._scenes:
            spec = load_scene(self.dataset, scene_id)
            self._scenes[scene_id] = with_bars(spec) if self._by_friction else spec
        return self._scenes[scene_id]

    def scene_ids(self) -> list[str]:
        """Returns the layouts of the episodes."""
        if self.available < UNLIMITED:
            return sorted({episode.scene_id for episode in self._episodes.values()})
        return [self.scene_id] if self.scene_id else self.dataset.scenes_of_split(self.split)

    def to_set(self, count: int) -> EpisodeSet:
        """Returns the first `count` episodes as one set."""
        return EpisodeSet(
            env=self.env_id,
            scene_dataset=self.dataset.name,
            split=self.split,
            seed=self.seed,
            made_from=self.made_from,
            episodes=tuple(self.get(index) for index in range(count)),
            rejections=dict(self.rejections),
            robot=self._request.robot,
        )

    def save(self, count: int, file: Path | None = None) -> Path:
        """Writes the first `count` episodes to `file`, or to the cache; returns the file."""
        episodes = self.to_set(count)
        if file is None:
            return write_cached(self._cached, lambda path: write_episodes(episodes, path))
        write_episodes(episodes, file)
        return file

    def make(self, index: int) -> Made:
        """Generates an episode, even if it already exists."""
        if self._generator is None:
            self._generator = self._new_generator()
        if self._request.clutter:
            return self._crowded(self._generator, index)
        split = self.split + self._variant
        return self._generator.generate(
            f"{self.env_id}/{self.dataset.name}/{split}/{self.seed}/{index:05d}",
            (stable_hash(self.dataset.name, split, self.env_id), self.seed, index),
            self._first_layout(index),
        )

    def _crowded(self, generator: base.Generator, index: int) -> Made:
        """Generates an episode with objects added to the one without."""
        if self._plain is None:
            self._plain = open_source(replace(self._request, clutter=0))
        episode, count = self._plain.get(index), self._request.clutter
        return crowded(generator, episode, count, (episode.seed, count))

    def _first_layout(self, index: int) -> str | None:
        """Returns the layout of an episode in a folder of layouts, which are used in turn."""
        if self.dataset.layouts is None:
            return None
        scenes = self.scene_ids()
        return scenes[index % len(scenes)]

    def _keep(self, index: int, made: Made) -> None:
        self._episodes[index] = made.episode
        self.rejections.update(made.rejections)

    def _new_generator(self) -> base.Generator:
        robot = robot_of(self._request.robot)
        names = UNSEEN_OBJECTS if self.novel == "objects" else TRAIN_OBJECTS
        drawn = Objects(
            templates=self.objects,
            names=spanned(names, self.objects, robot),
            receptacles=UNSEEN_RECEPTACLES if self.novel == "receptacles" else None,
            robot=robot,
        )
        return self._make_generator(self.scene_ids(), self.scene, drawn)

    def _take(self, episodes: EpisodeSet) -> None:
        self._episodes.update(enumerate(episodes.episodes))
        self.rejections = Counter(episodes.rejections)


def variant_of(request: EpisodeRequest) -> str:
    """Returns what follows the split in the ids of episodes that are not the protocol's."""
    others = {request.novel, request.robot} - {None, EpisodeRequest.robot}
    others |= {f"clutter{request.clutter}"} if request.clutter else set()
    return "".join(f"+{one}" for one in sorted(map(str, others)))


class _SharedSources(NamedTuple):
    sources: dict[EpisodeRequest, EpisodeSource]
    folder: Path | None


_shared: ContextVar[_SharedSources | None] = ContextVar("_shared", default=None)


@contextmanager
def shared_sources(folder: Path | None = None) -> Iterator[None]:
    """Lets all environments made in this context with the same request share one source.

    An episode is then read or generated once for all of them, and for those of other processes
    with the same `folder`.
    """
    token = _shared.set(_SharedSources({}, folder))
    try:
        yield
    finally:
        _shared.reset(token)


def open_source(request: EpisodeRequest) -> EpisodeSource:
    """Returns the source of the requested episodes; see also `shared_sources`.

    Raises:
        UnknownNameError: Unknown dataset, split, scene, novelty or objects folder.
        DatasetError: The dataset is damaged.
        EpisodeError: The episode file is damaged, or for another env.
    """
    shared = _shared.get() or _SharedSources({}, None)
    if request not in shared.sources:
        shared.sources[request] = EpisodeSource(request, shared.folder)
    return shared.sources[request]


def _start_worker(request: EpisodeRequest) -> Callable[[int], Made]:
    logging.disable(logging.WARNING)  # already logged by the parent
    return open_source(request).make
