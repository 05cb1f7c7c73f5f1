"""Named views of what was built."""

from __future__ import annotations

from dataclasses import dataclass, field

from mani_skill.utils.structs import Actor, Articulation

from hab_tasks.scenes.spec import SceneSpec


@dataclass(kw_only=True)
class SceneHandles:
    """What `build_scene` built.

    Attributes:
        spec: The layout it was built from.
        static: Object handle -> actor that never moves.
        loose: Object handle -> dynamic actor that belongs to the layout.
        articulations: Furniture handle -> articulation.
        pickables: Object name -> actor, parked unless the episode uses it.
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
