"""Receptacles of ReplicaCAD: names in Habitat's files, and names in words."""

from __future__ import annotations

_AABB = "receptacle_aabb_"
SOFA = f"{_AABB}Sofa_frl_apartment_sofa"
FRIDGE = f"{_AABB}middle_topfrl_apartment_refrigerator"
COUNTER_LEFT = f"{_AABB}counter_left_kitchen_counter"
COUNTER_RIGHT = f"{_AABB}counter_right_kitchen_counter"
SINK = f"{_AABB}sink_kitchen_counter"
TABLE_LIGHT = f"{_AABB}Tbl1_Top1_frl_apartment_table_01"
TABLE_DARK = f"{_AABB}Tbl2_Top1_frl_apartment_table_02"
CHAIR = f"{_AABB}Chr1_Top1_frl_apartment_chair_01"
TV_STAND = f"{_AABB}TvStnd1_Top1_frl_apartment_tvstand"
DRAWER = f"{_AABB}drawer_right_top_frl_apartment_kitchen_counter"
CABINET = tuple(f"{_AABB}WC1_Top{i}frl_apartment_wall_cabinet_01" for i in range(1, 7))
SHELVES = tuple(f"{_AABB}WC2_Top{i}_frl_apartment_wall_cabinet_02" for i in range(1, 7))

COUNTER = (COUNTER_LEFT, COUNTER_RIGHT)
PICK_RECEPTACLES = (SOFA, FRIDGE, *COUNTER, TABLE_LIGHT, TABLE_DARK)
"""Sofa, fridge, counter left and right, light and dark wood table (S H.2)."""

PLACE_RECEPTACLES = (*PICK_RECEPTACLES, SINK)
"""Receptacles of Pick, and the sink (S H.2)."""

UNSEEN_RECEPTACLES = (TABLE_DARK, *SHELVES, CHAIR)
"""Held-out receptacles of the generalisation study (S E.1)."""

OPEN_RECEPTACLES = (CHAIR, TABLE_LIGHT, TABLE_DARK, TV_STAND, SINK, *COUNTER, SOFA)
"""Receptacles of the tasks that need no opening (Habitat's set of eight)."""

ENCLOSED_RECEPTACLES = (
    f"{_AABB}bottomfrl_apartment_refrigerator",
    *(
        f"{_AABB}drawer_{position}_frl_apartment_kitchen_counter"
        for position in (
            "left_top",
            "left_bottom",
            "middle_top",
            "middle_middle",
            "middle_bottom",
            "right_bottom",
        )
    ),
)
"""Receptacles behind doors and in drawers that no skill opens."""

CONTAINERS = {FRIDGE: "fridge", DRAWER: "drawer"}
"""Receptacle -> articulation that encloses it, by its name in `hab_tasks.articulations`."""

PHRASES: dict[str, str] = {
    SOFA: "on the sofa",
    FRIDGE: "in the fridge",
    COUNTER_LEFT: "on the left counter",
    COUNTER_RIGHT: "on the right counter",
    SINK: "in the sink",
    TABLE_LIGHT: "on the light table",
    TABLE_DARK: "on the dark table",
    CHAIR: "on the chair",
    TV_STAND: "on the TV stand",
    DRAWER: "in the drawer",
    **dict.fromkeys(CABINET, "in the wall cabinet"),
    **dict.fromkeys(SHELVES, "on the shelves"),
}
"""Receptacle -> location in words, for every receptacle that a task can name."""
