"""Start states of Navigate (S H.2): anywhere in the room, the state of one of the other skills."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hab_tasks.episodes.generators.base import Generator, Objects, stage
from hab_tasks.episodes.generators.drawer import CloseDrawer, OpenDrawer
from hab_tasks.episodes.generators.fridge import CloseFridge, OpenFridge
from hab_tasks.episodes.generators.pick import Pick
from hab_tasks.episodes.generators.place import Place
from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.schema import Episode, NavigationGoal, template_of
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.navigation import LayoutMaps
from hab_tasks.scenes.spec import SceneSpec

LEADS_TO: dict[str, type[Generator]] = {
    "HabPick-v1": Pick,
    "HabPlace-v1": Place,
    "HabOpenFridge-v1": OpenFridge,
    "HabCloseFridge-v1": CloseFridge,
    "HabOpenDrawer-v1": OpenDrawer,
    "HabCloseDrawer-v1": CloseDrawer,
}
"""The six skills whose start poses are navigated to."""

LEAST_WAY_M = 1.0
"""Straight distance between start and goal at least."""


class Navigate(Generator):
    """The goal is the base pose that another skill would start from."""

    version = 9

    def __init__(
        self, scenes: Sequence[str], load: Callable[[str], SceneSpec], objects: Objects
    ) -> None:
        """Draws layouts from `scenes`; `load` reads one."""
        super().__init__(scenes, load, objects)
        self._maps = LayoutMaps(load)

    def attempt(self, bench: Workbench, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        skill = list(LEADS_TO)[int(rng.integers(len(LEADS_TO)))]
        leads_to = LEADS_TO[skill](self.scenes, self.load, self.objects)
        leads_to.refused = self.refused
        episode = leads_to.attempt(bench, rng)
        goal = NavigationGoal(skill=skill, base=episode.robot.base)
        objects = dict(episode.objects)
        robot = self.starts(bench, rng).anywhere(np.array(goal.base[:2]), LEAST_WAY_M)
        # The map by which the way is measured; in narrow aisles it may part what the bench joins.
        ends_m = np.array((robot.base[:2], goal.base[:2]))
        if not self._maps.of(bench.spec.scene_id, episode.joints).is_free(ends_m).all():
            raise RefusedError("no way from the start to the goal")
        if episode.held is not None and isinstance(leads_to, Place):
            held = episode.held
            up = np.array(bench.templates[template_of(held)].up)
            yaw = rng.uniform(-np.pi, np.pi)
            objects[held] = leads_to.in_hand(bench.com_in_object_m(held), up, robot, yaw)
            stage(bench, objects, episode.joints)
            if bench.touching(held):
                raise RefusedError("the held object touches something")
        return replace(episode, robot=robot, objects=objects, navigation=goal)
