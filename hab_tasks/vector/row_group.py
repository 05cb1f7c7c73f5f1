"""Many CPU simulations in one process, whose rules run once for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from hab_tasks.engine.episode_rows import EpisodeRows
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.measures import Tracker
from hab_tasks.engine.rules import Evaluation
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.schema import Episode
from hab_tasks.navigation import GeodesicDistances
from hab_tasks.robots.grasp import NOTHING


class RowGroup(EpisodeRows):
    """K simulations, stepped one after another; measures, rewards and ends are those of a batch.

    Each row is an environment of its own, which also resets itself: the group takes its state over.

    Attributes:
        envs: The environments.
        rules: Rules of all rows.
        steps: (K,) actions since the episode of each row began.
    """

    def __init__(self, envs: Sequence[HabEnv]) -> None:
        """Groups environments made with the same options; reset all before the first step."""
        self.envs = tuple(envs)
        first, count = envs[0], len(envs)
        requirements = first.requirements
        self._sizes = requirements.objects, len(requirements.articulations)
        self._simulations = [env.simulation for env in envs]
        self.maps = self._simulations[0].maps
        for simulation in self._simulations:
            simulation.maps = self.maps  # they differ in nothing, and take memory
        geodesic = GeodesicDistances(count) if requirements.navigates else None
        self.tracker = Tracker(Goals.empty(count, *self._sizes), geodesic)
        self._table = np.zeros((count, Snapshot.width(*self._sizes)), dtype=np.float32)
        self._held = np.full(count, NOTHING)
        self._held_handle = np.full(count, NOTHING)
        self._lost = np.zeros(count, dtype=bool)
        self._force_n = np.zeros(count, dtype=np.float32)
        self._take_snapshot()
        self.steps = np.zeros(count, dtype=np.int32)
        self.rules = first.rules_of(self)
        self.ee_step_m = self._simulations[0].ee_step_m
        self._physics_steps = first.sim_freq // first.control_freq

    @property
    def episodes(self) -> list[Episode]:
        """The episode of each row."""
        return [simulation.episodes[0] for simulation in self._simulations]

    def reset_row(self, row: int, seed: int | None, options: dict[str, Any] | None) -> Any:
        """Starts an episode in a row; returns the environment's observation."""
        obs, _ = self.envs[row].reset(seed=seed, options=options)
        self.tracker.copy_row(row, self._simulations[row].tracker)
        self._read(row)
        self._take_snapshot()
        self.rules.set_state(self.envs[row].rules.get_state(), torch.tensor([row]))
        self.steps[row] = 0
        return obs

    def step(self, actions: NDArray[Any], rows: Sequence[int]) -> None:
        """Executes one action in each of `rows`; the others are to be reset.

        Args:
            actions: (K, A) valid actions, or (K, 1) cells.
            rows: The rows to step.
        """
        envs, simulations = self.envs, self._simulations
        for row in rows:
            envs[row].act_row(actions[row])
        self.rules.before_action()
        controllers = [env.agent.controller for env in envs]
        gripper = np.array([float(c.gripper[0]) for c in controllers], dtype=np.float32)
        gripper = self.rules.masked_gripper(gripper)
        for row in rows:
            simulations[row].simulate(gripper[row : row + 1], self._physics_steps)
            self._read(row)
        self._take_snapshot()
        self.tracker.advance(self.snapshot, np.array([bool(c.stopped[0]) for c in controllers]))
        self.rules.after_action()
        for row in rows:
            noise = envs[row].noise
            if noise is not None:
                noise.advance()
        self.steps[list(rows)] += 1

    def evaluate(self) -> Evaluation:
        """Evaluates the rules for all rows; has no side effects."""
        return self.rules.evaluate()

    def lend(self, row: int) -> HabEnv:
        """Returns the environment of a row, with the group's measures in it."""
        env, simulation = self.envs[row], self._simulations[row]
        rows, here = torch.tensor([0]), slice(row, row + 1)
        simulation.read_snapshot(self._force_n[here])
        state = self.tracker.get_state()
        simulation.tracker.set_state({name: value[here] for name, value in state.items()}, rows)
        goals = {name: value[here] for name, value in self.goals.state().items()}
        simulation.tracker.goals = simulation.goals.changed([0], goals)
        if simulation.tracker.geodesic is not None and self.tracker.geodesic is not None:
            simulation.tracker.geodesic.copy_row(0, self.tracker.geodesic, row)
        rules = {
            group: {name: value[here] for name, value in values.items()}
            for group, values in self.rules.get_state().items()
        }
        env.rules.set_state(rules, rows)
        env.elapsed_steps[:] = int(self.steps[row])
        return env

    def _read(self, row: int) -> None:
        """Reads the simulation of a row."""
        reading = self._simulations[row].read_row(self._table[row])
        self._held[row], self._held_handle[row] = reading.held, reading.held_handle
        self._lost[row], self._force_n[row] = reading.lost, reading.force_n

    def _take_snapshot(self) -> None:
        """Makes a snapshot of what was read; earlier snapshots keep their numbers."""
        self.snapshot = Snapshot.of_table(
            self._table.copy(),
            *self._sizes,
            held=self._held.copy(),
            held_handle=self._held_handle.copy(),
            lost=self._lost.copy(),
            force_n=self._force_n.copy(),
        )
