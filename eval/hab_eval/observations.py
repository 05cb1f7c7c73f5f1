"""Observations as agents receive them: with ground-truth state, and images on demand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from hab_eval.errors import AgentError
from hab_tasks.agent import AgentSpec

if TYPE_CHECKING:
    import gymnasium as gym

IMAGES = ("sensor_param", "sensor_data")
"""Groups of an observation that need rendering."""


class LazyObservation(Mapping[str, Any]):
    """An observation whose images are rendered on first access and then cached."""

    def __init__(self, ready: Mapping[str, Any], look: Callable[[], Mapping[str, Any]]) -> None:
        """Takes the groups that need no rendering; `look` renders the groups `IMAGES`."""
        self._ready = ready
        self._look = look
        self._images: Mapping[str, Any] | None = None
        self._past = False

    def __getitem__(self, key: str) -> Any:
        if key not in IMAGES:
            return self._ready[key]
        if self._images is None:
            if self._past:
                raise AgentError(f"obs[{key!r}] can be read only until the next step.")
            self._images = self._look()
        return self._images[key]

    def __contains__(self, key: object) -> bool:
        return key in IMAGES or key in self._ready

    def __iter__(self) -> Iterator[str]:
        yield from self._ready
        yield from IMAGES

    def __len__(self) -> int:
        return len(self._ready) + len(IMAGES)

    def expire(self) -> None:
        """Forbids rendering from now on: the simulation is about to step."""
        self._past = True


def agent_view(
    env: gym.Env[Any, Any], spec: AgentSpec, obs: Mapping[str, Any]
) -> Mapping[str, Any]:
    """Returns the observation as an agent with this spec receives it."""
    base: Any = env.unwrapped
    if spec.privileged:
        obs = {**obs, "privileged": base.privileged()}
    return LazyObservation(obs, base.look) if spec.looks == "on demand" else obs
