"""The rows of a vector environment as those of a rollout."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from hab_tasks.engine.rollout import Job, Outcome


class VectorRows:
    """Rows of a vector environment, which step together.

    With seeds the environment chooses the episodes, and its autoreset mode `NEXT_STEP` starts
    them: a row whose episode is over shows its last observation for one more step. Without seeds
    the jobs have the episodes, and a row starts the next one at once; a row without a job repeats
    its last episode, uncounted.

    Attributes:
        count: Number of rows.
        fresh: (N,) bool, rows that show the first observation of an episode.
        over: (N,) bool, rows that show the last observation of one.
        last: (N,) reward, terminated and truncated of the last step.
    """

    def __init__(self, env: Any, seeds: Sequence[int] | None = None) -> None:
        """Takes an environment in autoreset mode `NEXT_STEP`, without seeds also `DISABLED`.

        Its rows have to be reset afterwards.
        """
        self._env, self._seeds, self._obs = env, seeds, None
        self.count: int = env.num_envs
        self.fresh, self.over = np.ones(self.count, dtype=bool), np.zeros(self.count, dtype=bool)
        self._shown: list[Any] = []
        self._return, self._steps = np.zeros(self.count), np.zeros(self.count, dtype=int)

    def start(self, jobs: Mapping[int, Job]) -> None:
        """See `Rows`."""
        episodes = [job.episode for job in jobs.values()]
        self._shown = self._shown or [episodes[n % len(episodes)] for n in range(self.count)]
        for row, job in jobs.items():
            self._shown[row] = job.episode

    def observe(self) -> Any:
        """See `Rows`."""
        if self._obs is None and self._seeds is not None:
            options = {"reconfigure": True}
            self._obs, _ = self._env.reset(seed=list(self._seeds), options=options)
        elif self._obs is None:
            self._obs, _ = self._env.reset(options={"episode": self._shown})
        elif self._seeds is None and self.over.any():
            options = {"reset_mask": self.over, "episode": self._shown}
            self._obs, _ = self._env.reset(options=options)
            self.fresh, self.over = self.over, np.zeros(self.count, dtype=bool)
        return self._obs

    def step(self, actions: Any, rows: Collection[int]) -> dict[int, Outcome]:
        """See `Rows`."""
        self._obs, *self.last, info = self._env.step(actions)
        reward, terminated, truncated = self.last
        self._return[self.fresh], self._steps[self.fresh] = 0.0, 0
        self._return += reward
        self._steps += ~self.over
        self.fresh, self.over = self.over, terminated | truncated
        return {
            row: Outcome.of(
                info, row, steps=int(self._steps[row]), episode_return=float(self._return[row])
            )
            for row in np.flatnonzero(self.over).tolist()
            if row in rows
        }

    def abort(self) -> None:
        """Does nothing: the rows have no observers."""
