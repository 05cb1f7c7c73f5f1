"""Where episodes come from: a file, the files shipped with the package, the cache, or generation.

An episode depends only on (dataset, split, seed, index): asking for 50 or for 500 gives the same
first 50, and asking again gives the same ones.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from hab_tasks.episodes.generate import GENERATOR_VERSION, PickGenerator, stable_hash
from hab_tasks.episodes.schema import Episode, EpisodeSet, read_episodes, write_episodes
from hab_tasks.errors import EpisodeError, UnknownNameError
from hab_tasks.scenes.dataset import SceneDataset, embedded_dataset, resolve_dataset
from hab_tasks.scenes.load import load_scene
from hab_tasks.scenes.meshes import cache_dir
from hab_tasks.scenes.objects import load_objects
from hab_tasks.scenes.spec import ObjectTemplate, SceneSpec

logger = logging.getLogger(__name__)

UNLIMITED = 1_000_000
GENERATORS = {"HabPick-v1": PickGenerator}
Progress = Callable[[int, int], None]


class EpisodeSource:
    """Episodes of one env, dataset, split and seed, by index.

    Attributes:
        dataset: The scene dataset.
        objects: Object name -> template of the movable objects.
        split: The resolved split.
        available: How many episodes there are.
        rejections: Reason -> candidates refused by this process's generation.
    """

    def __init__(
        self,
        *,
        env_id: str,
        dataset: SceneDataset,
        objects: dict[str, ObjectTemplate],
        objects_name: str,
        split: str,
        scene_id: str | None,
        seed: int,
    ) -> None:
        self.env_id, self.dataset, self.objects = env_id, dataset, objects
        self.split, self.seed, self.scene_id = split, seed, scene_id
        self.available = UNLIMITED
        self.rejections: Counter[str] = Counter()
        self._generator: PickGenerator | None = None
        self._episodes: dict[int, Episode] = {}
        self._scenes: dict[str, SceneSpec] = {}
        scope = f"{split}-{scene_id}" if scene_id else split
        self._name = f"{env_id}.{dataset.name}.{objects_name}.{scope}.{seed}.json.gz"
        shipped = dataset.root == embedded_dataset().resolve()
        self._embedded = _shipped_folder() / self._name if shipped else None
        masses = (f"{name} {template.mass_kg}" for name, template in sorted(objects.items()))
        made_from = f"{GENERATOR_VERSION} {dataset.fingerprint}"
        key = stable_hash(made_from, *masses)
        self._cached = cache_dir() / "episodes" / f"{key:08x}" / self._name
        # The cache may hold more episodes than were shipped; the shipped ones stay as they are.
        for file in (self._cached, self._embedded):
            if file is not None and file.exists():
                self._take(read_episodes(file))

    def get(self, index: int) -> Episode:
        """Returns episode number `index`, generating it when it is not known yet.

        Raises:
            EpisodeError: The source is a file with fewer episodes.
            GenerationError: No acceptable start state was found.
        """
        if not 0 <= index < self.available:
            raise EpisodeError(f"Episode {index}: valid are 0 to {self.available - 1}.")
        if index not in self._episodes:
            self._generate(index)
        return self._episodes[index]

    def scene(self, scene_id: str) -> SceneSpec:
        """Returns a layout, read once."""
        if scene_id not in self._scenes:
            self._scenes[scene_id] = load_scene(self.dataset, scene_id)
        return self._scenes[scene_id]

    def to_set(self, count: int) -> EpisodeSet:
        """Returns the first `count` episodes as one set."""
        return EpisodeSet(
            env=self.env_id,
            scene_dataset=self.dataset.name,
            split=self.split,
            seed=self.seed,
            episodes=tuple(self.get(index) for index in range(count)),
            rejections=dict(self.rejections),
        )

    def save(self, count: int, file: Path | None = None) -> Path:
        """Writes the first `count` episodes to `file`, or to the cache; returns the file."""
        target = file or self._cached
        write_episodes(self.to_set(count), target)
        return target

    def _generate(self, index: int) -> None:
        if self._generator is None:
            if self.env_id not in GENERATORS:
                raise UnknownNameError("env with generated episodes", self.env_id, GENERATORS)
            scenes = [self.scene_id] if self.scene_id else self.dataset.scenes_of_split(self.split)
            self._generator = GENERATORS[self.env_id](
                scenes=scenes, load=self.scene, objects=self.objects
            )
        made = self._generator.generate(
            f"{self.env_id}/{self.dataset.name}/{self.split}/{self.seed}/{index:05d}",
            (stable_hash(self.dataset.name, self.split, self.env_id), self.seed, index),
        )
        self._episodes[index] = made.episode
        self.rejections.update(made.rejections)

    def _take(self, episodes: EpisodeSet) -> None:
        self._episodes.update(enumerate(episodes.episodes))
        self.rejections = Counter(episodes.rejections)


def open_source(
    *,
    env_id: str,
    scene_dataset: str | Path = "apartment",
    objects: str | Path | None = None,
    split: str | None = None,
    scene_id: str | None = None,
    episode_file: str | Path | None = None,
    seed: int = 0,
) -> EpisodeSource:
    """Returns the episodes for an env on a dataset.

    Raises:
        UnknownNameError: Unknown dataset, split, scene or objects folder.
        DatasetError: The dataset is damaged.
        EpisodeError: The episode file is damaged, or made for another env.
    """
    dataset = resolve_dataset(scene_dataset)
    if scene_id is not None:
        dataset.scene_file(scene_id)
    source = EpisodeSource(
        env_id=env_id,
        dataset=dataset,
        objects=load_objects(objects),
        objects_name="embedded" if objects is None else "ycb",
        split=_split(dataset, split, scene_id),
        scene_id=scene_id,
        seed=seed,
    )
    if episode_file is not None:
        given = read_episodes(Path(episode_file))
        if given.env != env_id:
            raise EpisodeError(f"{episode_file}: made for {given.env}, not for {env_id}.")
        for episode in given.episodes:
            dataset.scene_file(episode.scene_id)
        source._take(given)
        source.split, source.available = given.split, len(given)
    return source


def load_episodes(
    env_id: str,
    scene_dataset: str | Path = "apartment",
    objects: str | Path | None = None,
    split: str | None = None,
    count: int = 50,
    seed: int = 0,
    scene: str | None = None,
    progress: Progress | None = None,
) -> EpisodeSet:
    """Returns the first `count` episodes; newly generated ones are kept in the cache.

    Args:
        env_id: The environment they are for.
        scene_dataset: ``apartment`` or the path of a ReplicaCAD folder.
        objects: Path of a YCB folder; None for the embedded objects.
        split: ``train``, ``val`` or ``test``; None for the most unseen one that the dataset has.
        count: How many.
        seed: Seed of the episodes.
        scene: Only episodes in this layout.
        progress: Called with (episodes ready, `count`) after each one.
    """
    source = open_source(
        env_id=env_id,
        scene_dataset=scene_dataset,
        objects=objects,
        split=split,
        scene_id=scene,
        seed=seed,
    )
    new = any(index not in source._episodes for index in range(count))
    for index in range(count):
        source.get(index)
        if progress is not None:
            progress(index + 1, count)
    if new:
        source.save(count)
    return source.to_set(count)


def _split(dataset: SceneDataset, split: str | None, scene_id: str | None) -> str:
    if scene_id is not None and split is None:
        for name in ("train", "val", "test"):
            if scene_id in dataset.scenes_of_split(name):
                return name
        return "none"
    return dataset.resolve_split(split)


def _shipped_folder() -> Path:
    # By name: packaging puts the folder assets/ there, where a type checker does not look.
    assets = import_module("hab_tasks.assets")
    return Path(next(iter(assets.__path__))) / "episodes"
