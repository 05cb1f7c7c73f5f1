"""Hand-written episodes in Habitat's format, in the apartment's first layout."""

from pathlib import Path
from typing import Any

import numpy as np
from hab_authoring.habitat.convert import read_habitat
from transforms3d.axangles import axangle2mat
from transforms3d.quaternions import axangle2quat

from hab_tasks.episodes.schema import EpisodeSet, save_json
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.objects import load_objects

APARTMENT, OBJECTS = resolve_dataset("apartment"), load_objects(None)
SCENE = "v3_sc0_staging_00"
DRAWER = "receptacle_aabb_drawer_right_top_frl_apartment_kitchen_counter"
SHELF = "receptacle_aabb_middle_topfrl_apartment_refrigerator"
TABLE = "receptacle_aabb_Tbl1_Top1_frl_apartment_table_01"
SOFA = "receptacle_aabb_Sofa_frl_apartment_sofa"


def matrix(x, y, z, heading_rad=0.0, tilt_rad=0.0, digits=5):
    """A (4, 4) matrix of rows: turned about Habitat's up axis y, then tilted about its own x."""
    turn = axangle2mat((0, 1, 0), heading_rad)
    rows = np.eye(4)
    rows[:3, :3] = turn @ axangle2mat((1, 0, 0), tilt_rad)
    rows[:3, 3] = (x, y, z)
    return rows.round(digits).tolist()


MARKERS = [
    {
        "name": name,
        "type": "articulated_object",
        "params": {"offset": offset, "link": link, "object": f"{furniture}_:0000"},
    }
    for name, link, furniture, offset in (
        ("cab_push_point_7", "drawer1_top", "kitchen_counter", [0.3, 0.0, 0]),
        ("cab_push_point_6", "drawer2_top", "kitchen_counter", [0.3, 0.0, 0]),
        ("cab_push_point_5", "drawer3", "kitchen_counter", [0.3, 0.0, 0]),
        ("cab_push_point_4", "drawer4", "kitchen_counter", [0.3, 0.0, 0]),
        ("fridge_push_point", "top_door", "fridge", [0.10, -0.62, 0.2]),
    )
]


def set_table(**changes):
    """An episode as Habitat's generator writes it: five digits, clutter, two bowls, open fridge."""
    return {
        "episode_id": "7",
        "scene_id": f"data/apartment/configs/scenes/{SCENE}.scene_instance.json",
        "scene_dataset_config": "data/apartment/apartment.scene_dataset_config.json",
        "additional_obj_config_paths": ["data/objects/ycb/configs/"],
        "start_position": [0, 0, 0],
        "start_rotation": [0, 0, 0, 1],
        "info": {"object_labels": {"024_bowl_:0001": "bowl|0", "013_apple_:0000": "fruit|1"}},
        "ao_states": {"fridge_:0000": {"2": 1.5}, "kitchen_counter_:0000": {"7": 0.25, "1": 0.0}},
        "rigid_objs": [
            ["024_bowl.object_config.json", matrix(1.1, 0.83456, 2.2, 0.4)],
            ["003_cracker_box.object_config.json", matrix(-0.5, 0.61, 1.75, 2.9, 0.01)],
            ["024_bowl.object_config.json", matrix(0.7, 0.9, 6.1, -1.234)],
            ["013_apple.object_config.json", matrix(0.5, 1.2, 4.4, 0.77, 1.1)],
        ],
        "targets": {
            "024_bowl_:0001": matrix(2.5, 0.6, 3.3, 0.2),
            "013_apple_:0000": matrix(2.5, 0.65, 3.3, 3.0),
        },
        "markers": MARKERS,
        "target_receptacles": [["kitchen_counter_:0000", 7], ["fridge_:0000", 0]],
        "goal_receptacles": [["frl_apartment_table_01_:0000", None] for _ in range(2)],
        "name_to_receptacle": {
            "024_bowl_:0000": SOFA,
            "003_cracker_box_:0000": TABLE,
            "024_bowl_:0001": DRAWER,
            "013_apple_:0000": SHELF,
        },
    } | changes


def tidy_house(**changes):
    """Full precision, a robot start with a height and a tilt, goals on several receptacles."""
    up = axangle2quat((0.02, 1, 0), 0.6)
    return (
        set_table(
            episode_id="12",
            info={
                "object_labels": {"003_cracker_box_:0000": "any_targets|0"},
                "seen": [1, {"a": None}],
            },
            start_position=[1.25, 0.1302, -2.5],
            start_rotation=[*up[1:], up[0]],
            ao_states={},
            rigid_objs=[["003_cracker_box.object_config.json", matrix(1, 2, 3, 0.5, 0.25, 15)]],
            targets={"003_cracker_box_:0000": matrix(-1, 0.7, 2, 0.1, 0.0, 15)},
            target_receptacles=[["frl_apartment_chair_01_:0001", None]],
            goal_receptacles=[["kitchen_counter_:0000", 0]],
            name_to_receptacle={
                "003_cracker_box_:0000": "frl_apartment_chair_01_:0001|receptacle_aabb_Chr1_Top1_"
                "frl_apartment_chair_01"
            },
        )
        | changes
    )


ENTRIES = {
    "set_table": set_table(),
    "tidy_house": tidy_house(),
    # Neither receptacles nor their names; a bare scene id.
    "first_release": {
        key: value
        for key, value in set_table(
            scene_id=SCENE, scene_dataset_config="default", info=None
        ).items()
        if "receptacle" not in key and key != "markers"
    },
    "unknown_fields": set_table(viewpoints=[[1, 2.5]], markers=MARKERS[:1], note="kept"),
    "no_targets": set_table(targets={}, target_receptacles=[], goal_receptacles=[], info={}),
    "later_target_first": set_table(
        targets={k: set_table()["targets"][k] for k in ("013_apple_:0000", "024_bowl_:0001")}
    ),
}


def read(folder: Path, *entries: Any, name: str = "habitat.json") -> EpisodeSet:
    """Writes entries to a file as Habitat does, and reads it."""
    save_json({"config": None, "episodes": list(entries)}, folder / name, sort_keys=False)
    return read_habitat(folder / name, APARTMENT, OBJECTS)
