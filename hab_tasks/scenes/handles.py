"""Named views of what stands in the scene."""

from __future__ import annotations

from dataclasses import dataclass, field

from mani_skill.utils.structs import Actor, Articulation

from hab_tasks.scenes.spec import SceneSpec


@dataclass(kw_only=True)
class SceneHandles:
    """What of the pool is shown.

    Attributes:
        spec: The layout.
        static: Object handle -> actor that never moves.
        loose: Object handle -> dynamic actor that belongs to the layout.
        articulations: Furniture handle -> articulation.
        pickables: Object handle -> actor of a movable object; on the GPU, where bodies cannot leave
            the scene, also those that wait for another row's episode.
        parking: The slab under the floor on which those wait.
    """

    spec: SceneSpec
    stage: Actor | None = None
    parking: Actor | None = None
    static: dict[str, Actor] = field(default_factory=dict)
    loose: dict[str, Actor] = field(default_factory=dict)
    articulations: dict[str, Articulation] = field(default_factory=dict)
    pickables: dict[str, Actor] = field(default_factory=dict)

    @property
    def movable(self) -> dict[str, Actor]:
        """Everything a gripper can take: pickables first, then the layout's loose objects."""
        return {**self.pickables, **self.loose}
