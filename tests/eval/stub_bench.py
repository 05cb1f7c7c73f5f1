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
