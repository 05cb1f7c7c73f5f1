"""Objects that a hand which grasps by friction can span."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hab_tasks.errors import GenerationError
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.scenes.meshes import smallest_side_m
from hab_tasks.world.scenes.spec import ObjectTemplate


def spanned(
    names: Sequence[str], templates: Mapping[str, ObjectTemplate], robot: RobotSpec
) -> tuple[str, ...]:
    """Returns the objects that a hand can grasp, by the smallest side of each.

    Raises:
        GenerationError: It can grasp none.
    """
    if robot.fingers is None:
        return tuple(names)
    sides_m = {
        name: min(
            2 * min(one.half_size_m) if one.file is None else smallest_side_m(one.file)
            for one in templates[name].collision
        )
        for name in names
    }
    found = tuple(name for name, side_m in sides_m.items() if side_m <= robot.fingers.spans_m)
    if not found:
        widths = ", ".join(f"{name} {side_m:.3f} m" for name, side_m in sides_m.items())
        raise GenerationError(
            f"The hand of {robot.uid} spans {robot.fingers.spans_m:.3f} m, and no object: {widths}."
        )
    return found
