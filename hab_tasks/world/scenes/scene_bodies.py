"""Bodies of a scene by name."""

from __future__ import annotations

from dataclasses import dataclass, field

from mani_skill.utils.structs import Actor, Articulation

from hab_tasks.world.scenes.spec import SceneSpec


@dataclass(kw_only=True)
class SceneBodies:
    """Active bodies of a pool.

    Attributes:
        spec: The layout.
        static: Object name -> static actor.
        loose: Object name -> dynamic actor that belongs to the layout.
        articulations: Furniture name -> articulation.
        pickables: Object name -> actor of a movable object.
    """

    spec: SceneSpec
    stage: Actor | None = None
    static: dict[str, Actor] = field(default_factory=dict)
    loose: dict[str, Actor] = field(default_factory=dict)
    articulations: dict[str, Articulation] = field(default_factory=dict)
    pickables: dict[str, Actor] = field(default_factory=dict)

    @property
    def movable(self) -> dict[str, Actor]:
        """All graspable objects: pickables first, then the layout's loose objects."""
        return {**self.pickables, **self.loose}
