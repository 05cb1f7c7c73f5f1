"""Access to SAPIEN objects; the only module that reads ManiSkill's private members."""

from __future__ import annotations

from typing import Any


def sapien_object(wrapped: Any, row: int = 0) -> Any:
    """Returns the SAPIEN entity, articulation, link or joint of a row."""
    return wrapped._objs[row]


def sapien_objects(wrapped: Any) -> list[Any]:
    """Returns the SAPIEN entities, articulations, links or joints of all rows."""
    return wrapped._objs


def rigid_body(actor: Any, row: int = 0) -> Any:
    """Returns the rigid body of an actor in a row."""
    return actor._bodies[row]


def rigid_bodies(actor: Any) -> list[Any]:
    """Returns the rigid bodies of an actor in all rows."""
    return actor._bodies


def set_up(scene: Any) -> None:
    """Sets up a CPU scene without an environment."""
    scene._setup(enable_gpu=False)


def push_to_gpu(scene: Any) -> None:
    """Writes pending changes to the GPU simulation."""
    scene._gpu_apply_all()


def pull_from_gpu(scene: Any) -> None:
    """Reads results from the GPU simulation."""
    scene._gpu_fetch_all()
