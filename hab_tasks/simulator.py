"""Access to SAPIEN objects; the only module that reads ManiSkill's private members."""

from __future__ import annotations

from typing import Any


def sapien_object(wrapped: Any) -> Any:
    """Returns the SAPIEN entity, articulation, link or joint."""
    return wrapped._objs[0]


def rigid_body(actor: Any) -> Any:
    """Returns the rigid body of an actor."""
    return actor._bodies[0]


def set_up(scene: Any) -> None:
    """Sets up a CPU scene without an environment."""
    scene._setup(enable_gpu=False)
