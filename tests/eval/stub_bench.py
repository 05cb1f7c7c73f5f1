"""Stub environments of a benchmark, importable in the process that `RemoteEnv` starts."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from types import SimpleNamespace

import torch
from hab_eval.bench.motion import Motion
from hab_eval.bench.process import StepTiming, time_steps

ENGINE_S = 0.002
OTHER_S = 0.002


class Engine:
    __slots__ = ()  # cannot be patched, like SAPIEN's engine

    timestep = 1 / 120

    def step(self) -> None:
        time.sleep(ENGINE_S)


class Env:
    """Sleeps half of its step inside the engine."""

    def __init__(self, *, uses_engine: bool = True) -> None:
        self.scene = SimpleNamespace(px=Engine())
        self.unwrapped = self
        self.actions: list[torch.Tensor] = []
        self._uses_engine = uses_engine

    def step(self, action) -> None:
        self.actions.append(action)
        time.sleep(OTHER_S)
        if self._uses_engine:
            assert self.scene.px.timestep == 1 / 120
            self.scene.px.step()


class StubEnv:
    def run_steps(self, motion: Motion) -> StepTiming:
        return time_steps(Env(), torch.zeros(2), torch.full((motion.count, 2), float(motion.seed)))

    def soft_reset(self) -> float:
        return float(os.environ["STUB_RESET_S"])

    def other_layout(self) -> float:
        raise ZeroDivisionError("no other scene")

    def close(self) -> None:
        pass


@dataclass(frozen=True)
class Factory:
    def __call__(self) -> StubEnv:
        return StubEnv()


@dataclass(frozen=True)
class DyingFactory:
    def __call__(self) -> StubEnv:
        os._exit(7)


class CountedEnv:
    """Cycles through episodes with 10, 30 and 100 objects; the engine takes 1 ms per step.

    Outside the engine, an object takes 1 us per step, and each cycle is twice as slow as the one
    before, as on a shared machine.
    """

    def __init__(self) -> None:
        self.counts: list[int] = []
        self._resets = 0

    def run_steps(self, motion: Motion) -> StepTiming:
        count = (10, 30, 100)[self._resets % 3]
        self.counts.append(count)
        outside_s = (1e-3 + 1e-6 * count) * 2.0 ** (self._resets // 3)
        engine_s = 1e-3 * motion.count
        total_s = engine_s + outside_s * motion.count
        return StepTiming(steps=motion.count, total_s=total_s, engine_s=engine_s)

    def soft_reset(self) -> float:
        self._resets += 1
        return 0.0

    def other_layout(self) -> float:
        raise AssertionError("suite objects stays in its layout")

    def layouts(self) -> int:
        return 1

    def close(self) -> None:
        pass


class Vector:
    """A vector environment whose workers are all the current process.

    Attributes:
        calls: Shared by all vectors of a test: (number of environments, what was called).
    """

    def __init__(self, size: int, calls: list[tuple[int, str]]) -> None:
        self._size, self._calls = size, calls

    def run_steps(self, count: int, seed: int) -> float:
        self._calls.append((self._size, f"{count} steps, seed {seed}"))
        return 100.0 * self._size + seed

    def pids(self) -> tuple[int, ...]:
        return (os.getpid(),) * self._size

    def close(self) -> None:
        self._calls.append((self._size, "close"))
