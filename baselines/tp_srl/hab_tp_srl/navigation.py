"""Learned navigation with a map (`hab_ppo.navigation`), for several rows at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from hab_ppo.navigation.navigator import REPEAT, Navigator
from hab_ppo.navigation.weights import load

from hab_tasks.agent import AgentSetup, of_rows
from hab_tasks.constants import NAVIGATE_HORIZON_STEPS
from hab_tasks.robots.control import HabControllerConfig, control_configs
from hab_tp_srl.policies import Turn


class NavigatorPolicy:
    """Navigates as a skill of a task, to the first stop, with one map for the whole episode.

    If the stage is tried again, it excludes the places where it stopped before, and goes to another
    one. The attributes are those of `SkillPolicy`.
    """

    name = "navigator"
    horizon_steps = NAVIGATE_HORIZON_STEPS
    obs_mode = "depth"
    sees_handles, sees_images = False, True
    starts = None

    def __init__(self, setup: AgentSetup, path: Path) -> None:
        """Loads the weights of a file.

        Raises:
            PolicyFileError: The file cannot be used.
        """
        self._network, self._device = load(path)[0].to(setup.device), setup.device
        self.control: HabControllerConfig = control_configs()["base_discrete"]

    def goes_on(self, turn: Turn) -> bool:
        """See `SkillPolicy.goes_on`; the next step is one in which it acts."""
        turn.age = -(-turn.age // REPEAT) * REPEAT
        return True

    def decide(self, rows: Sequence[int], turns: Sequence[Turn], obs: Mapping[str, Any]) -> None:
        """See `SkillPolicy.decide`."""
        for row, turn in zip(rows, turns, strict=True):
            if turn.age == 0:
                # A stop ends the skill, so that it must be at the goal.
                last = None if turn.before is None else turn.before.memory
                map_ = None if last is None else last.map
                turn.memory = Navigator(self._network, self._device, "once", map_)
                turn.before = None
            if turn.age % REPEAT == 0:
                images = of_rows(obs, [row])["sensor_data"]
                action = turn.memory.action(
                    np.asarray(images["head"]["depth"][0]),
                    turn.entries["extra", "point_in_base"].astype(float),
                    bool(turn.entries["agent", "is_holding"].item() > 0),
                    turn.base,
                )
                turn.action = np.array([action])
            turn.age += 1
