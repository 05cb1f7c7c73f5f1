"""Rows of episodes: the one control step, its snapshot, measures and rules.

A control step of K rows: actions, gripper mask, four physics steps each, reading, snapshot,
measures, rules. An environment is a group of one row; a worker of `make_vec` joins several.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hab_tasks.arrays import Batch, Floats
from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import GeodesicDistances, Measures, Tracker
from hab_tasks.engine.rules import Rules
from hab_tasks.engine.sensors import ARM_QPOS, ObsEntry
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.schema import Episode
from hab_tasks.robots.grasp import NOTHING


class Rows:
    """K simulations, stepped one after another; measures, rewards and ends are those of a batch.

    Attributes:
        simulations: The simulation of each row.
        snapshot: Snapshot of the simulators after the latest action or reset.
        tracker: Updates the measures; holds the goals.
        rules: Rules of all rows.
        maps: Navigation maps of the layouts.
        steps: (K,) actions since the episode of each row began.
    """

    def __init__(
        self, simulations: Sequence[EpisodeSimulation], rules_of: Callable[[Rows], Rules]
    ) -> None:
        """Joins simulations with the same requirements; `rules_of` makes the rules of all."""
        self.simulations = tuple(simulations)
        first, count = simulations[0], len(simulations)
        requirements = first.requirements
        arm = len(first.robot.arm_joints)
        fingers = len(first.robot.finger_joints)
        self._sizes = arm, fingers, requirements.objects, len(requirements.articulations)
        self.maps = first.maps
        # An environment has made a group of one of its simulation; a worker joins it with others
        # anew.
        for number, simulation in enumerate(simulations):
            simulation.rows, simulation.row = self, number
            simulation.maps = self.maps  # they differ in nothing, and take memory
        geodesic = GeodesicDistances(count) if requirements.navigates else None
        self.tracker = Tracker(Goals.empty(count, *self._sizes[2:]), geodesic)
        # One table for all rows and fields, so that a snapshot is one copy.
        self._table = np.zeros((count, Snapshot.width(*self._sizes)), dtype=np.float32)
        self._held = np.full((2, count), NOTHING)
        self._lost = np.zeros(count, dtype=bool)
        self._force_n = np.zeros(count, dtype=np.float32)
        self._take_snapshot()
        self.steps = np.zeros(count, dtype=np.int32)
        self.rules = rules_of(self)

    @property
    def episodes(self) -> list[Episode]:
        """The episode of each row."""
        return [simulation.episode for simulation in self.simulations]

    @property
    def goals(self) -> Goals:
        """Goals of the current episodes."""
        return self.tracker.goals

    @property
    def measures(self) -> Measures:
        """The measures after the latest control step."""
        return self.tracker.measures

    @property
    def ee_step_m(self) -> float:
        """Maximum displacement of the end-effector per action."""
        return self.simulations[0].ee_step_m

    def set_navigation_goal(self, row: int) -> None:
        """Starts measuring the geodesic distance of a row to its navigation goal."""
        geodesic = self.tracker.geodesic
        if geodesic is not None:
            goal = np.array(self.goals.base[row, :2].tolist())
            episode = self.simulations[row].episode
            geodesic.set_goal(row, self.maps.of(episode.scene_id, episode.joints), goal)

    def begin(self, row: int) -> None:
        """Starts the measures of a row, after its simulation has applied an episode."""
        simulation, tracker = self.simulations[row], self.tracker
        tracker.targets[row], tracker.handles[row] = simulation.targets, simulation.handles
        # Read first: where nothing is to be placed, the goal of an object is where it starts.
        self._read(row)
        self._take_snapshot()
        values = simulation.goal_values(self.snapshot.objects_m[row])
        tracker.goals = self.goals.changed([row], {name: [v] for name, v in values.items()})
        if simulation.episode.navigation is not None:
            self.set_navigation_goal(row)
        # After the goals, as the first measures are distances to them.
        tracker.begin(self.snapshot, [row])
        self.rules.begin_rows([row])
        self.steps[row] = 0

    def step(self, actions: Mapping[int, Batch | None]) -> None:
        """Executes one control step in some rows; the others are to be reset.

        An action is valid, (A,), or a cell (1,); None keeps the drive targets.
        """
        simulations = self.simulations
        for row, action in actions.items():
            if action is not None:
                simulations[row].act(action)
        # Rules are of all rows; what they say of rows that are not stepped goes unused.
        self.rules.before_action()
        wanted = np.array([simulation.gripper for simulation in simulations], dtype=np.float32)
        # By the measures of the last step, which the agent has seen.
        gripper = self.rules.masked_gripper(wanted).tolist()
        for row in actions:
            simulations[row].step(gripper[row])
            self._read(row)
        self._take_snapshot()
        stopped = np.array([simulation.stopped for simulation in simulations])
        # In all rows: those that were not stepped are reset next, which starts their measures anew.
        self.tracker.advance(self.snapshot, stopped)
        self.rules.after_action()
        for row in actions:
            self.steps[row] += 1
            noise = simulations[row].noise
            if noise is not None:
                # After the rules and before the observation, once a step: reading twice gives the
                # same.
                noise.advance()

    # State -----------------------------------------------------------------------------------

    def get_state(self, row: int) -> dict[str, Any]:
        """Returns the state of a row's episode, without that of its bodies: nested (1, ...)."""
        here = {"tracker": self.tracker.get_state(), "goals": self.goals.state()}
        whole = {**here, **self.rules.get_state()}
        mine: dict[str, Any] = {
            group: {name: value[row : row + 1] for name, value in values.items()}
            for group, values in whole.items()
        }
        kept = {name: mine.pop(name) for name in here}
        return {"hab": {**kept, **self.simulations[row].get_state()}, **mine}

    def set_state(self, row: int, state: Mapping[str, Any]) -> None:
        """Restores a state of `get_state`, after the bodies' state was set."""
        simulation, tracker, kept = self.simulations[row], self.tracker, state["hab"]
        simulation.set_state(kept, touched=bool(kept["tracker"]["force_n"][0] > 0))
        tracker.set_state(kept["tracker"], [row])
        simulation.targets = tracker.targets[row].tolist()
        simulation.handles = tracker.handles[row].tolist()
        tracker.goals = self.goals.changed([row], kept["goals"])
        self.set_navigation_goal(row)
        self._read(row)
        # Contacts are no part of a state; the force of its step is among its measures.
        self._force_n[row] = tracker.measures.force_n[row]
        self._take_snapshot()
        self.rules.set_state(state, [row])

    def _read(self, row: int) -> None:
        """Reads the simulation of a row."""
        simulation = self.simulations[row]
        self._force_n[row] = simulation.read(self._table[row])
        grasp = simulation.grasp
        self._held[:, row], self._lost[row] = (grasp.held, grasp.held_handle), grasp.lost

    def _take_snapshot(self) -> None:
        """Makes a snapshot of what was read; earlier snapshots keep their numbers."""
        held, held_handle = self._held.copy()
        self.snapshot = Snapshot.of_table(
            self._table.copy(),
            *self._sizes,
            held=held,
            held_handle=held_handle,
            lost=self._lost.copy(),
            force_n=self._force_n.copy(),
        )


def read_entries(entries: Iterable[ObsEntry], rows: Rows) -> dict[str, Batch]:
    """Returns the entries of the state observation by name, (K, ...) each, with sensor noise."""
    now = rows.snapshot, rows.measures, rows.goals
    return {
        entry.name: _noisy(entry.read(*now), rows)
        if entry.name == ARM_QPOS.name
        else entry.read(*now)
        for entry in entries
    }


def _noisy(qpos_rad: Floats, rows: Rows) -> Floats:
    """Returns joint angles (K, J) with each row's noise."""
    sources = [simulation.noise for simulation in rows.simulations]
    if sources[0] is None:
        return qpos_rad
    pairs = zip(qpos_rad, sources, strict=True)  # all rows have noise, or none
    return np.array([q if source is None else source.joints(q) for q, source in pairs])
