"""What episodes are requested by."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hab_tasks.errors import OptionError
from hab_tasks.option_values import LARGEST_SEED, name, path, whole
from hab_tasks.robots.fetch import FETCH


@dataclass(frozen=True, kw_only=True)
class EpisodeRequest:
    """A request for episodes.

    Attributes:
        env_id: Their environment.
        scene_dataset: ``apartment``, ``replica_cad``, or the path of a ReplicaCAD folder.
        objects: Path of a YCB folder; None for the embedded objects.
        split: ``train``, ``val`` or ``test``; None picks the least-seen split available.
        scene: Restrict episodes to this layout.
        file: An episode file instead of generated episodes.
        seed: Seed of the generated episodes.
        novel: ``objects`` or ``receptacles``: use those held out for evaluation (S E.1); None for
            the training objects and the skill's own receptacles.
        robot: ManiSkill's uid of the robot.
    """

    env_id: str
    scene_dataset: str | Path = "apartment"
    objects: str | Path | None = None
    split: str | None = None
    scene: str | None = None
    file: str | Path | None = None
    seed: int = 0
    novel: str | None = None
    robot: str = FETCH.uid

    def __post_init__(self) -> None:
        """Rejects values of a wrong type."""
        whole("seed", self.seed, 0, LARGEST_SEED)
        for option in ("split", "scene", "novel"):
            name(option, getattr(self, option))
        for option in ("scene_dataset", "objects", "file"):
            path(option, getattr(self, option))
        if self.scene_dataset is None:
            raise OptionError.of_value("scene_dataset", None, "a path or a name")
