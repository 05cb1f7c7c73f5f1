"""Episodes of N rows as seen by the rules: latest snapshot, measures, goals and maps."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Tracker
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.schema import Episode
from hab_tasks.navigation import LayoutMaps


class EpisodeRows(ABC):
    """Running episodes, one per row.

    Attributes:
        snapshot: Snapshot of the simulator after the latest action or reset.
        tracker: Updates the measures; holds the goals.
        maps: Navigation maps of the layouts.
        ee_step_m: Maximum displacement of the end-effector per action.
    """

    snapshot: Snapshot
    tracker: Tracker
    maps: LayoutMaps
    ee_step_m: float

    @property
    @abstractmethod
    def episodes(self) -> list[Episode]:
        """The episode of each row."""

    @property
    def goals(self) -> Goals:
        """Goals of the current episodes."""
        return self.tracker.goals

    def set_navigation_goal(self, row: int) -> None:
        """Starts measuring the geodesic distance of a row to its navigation goal."""
        geodesic = self.tracker.geodesic
        if geodesic is not None:
            goal = np.array(self.goals.base[row, :2].tolist())
            episode = self.episodes[row]
            geodesic.set_goal(row, self.maps.of(episode.scene_id, episode.joints), goal)
