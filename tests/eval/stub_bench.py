"""A stub environment of a benchmark."""

from __future__ import annotations

import time
from types import SimpleNamespace

import torch

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
