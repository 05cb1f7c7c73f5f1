"""Figures of datasets and episode files: numbers and drawn content."""

import math

import pytest
from builders import tiny_dataset, tiny_scene, write_scene
from hab_authoring.commands import datasets
from hab_authoring.figures.layouts import moved_furniture
from hab_authoring.figures.statistics import (
    IN_GRASP,
    category_counts,
    episode_statistics,
    furniture_counts,
)
from hab_authoring.inventory import macro_layouts, micro_variations

from hab_tasks.episodes.schema import (
    Episode,
    EpisodeSet,
    HandleRef,
    MadeFrom,
    NavigationGoal,
    Rearrangement,
    RobotStart,
    write_episodes,
)
from hab_tasks.errors import RenderingUnavailableError
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene

MACRO = "v3_sc0_staging_00"
PREFIX = "receptacle_aabb_"
TABLE = (f"{PREFIX}Tbl1_Top1_frl_apartment_table_01", "frl_apartment_table_01_:0000")
SINK = (f"{PREFIX}sink_kitchen_counter", "kitchen_counter_:0000/body")
BOWL, APPLE = "024_bowl_:0000", "013_apple_:0000"


@pytest.fixture
def tiny(tmp_path):
    return tiny_dataset(tmp_path / "tiny")


def thing(template, translation, motion_type="STATIC", **more):
    entry = {"template_name": template, "translation": translation, "motion_type": motion_type}
    return entry | more


def variation(root, number, *things):
    """A layout of the tiny dataset with other objects."""
    scene = tiny_scene() | {"object_instances": list(things)}
    write_scene(root, scene, f"v3_sc0_staging_{number:02d}")


@pytest.mark.assets
def test_numbers_of_the_real_dataset(replica_cad):
    dataset = SceneDataset(replica_cad)
    categories = category_counts(dataset)
    assert sum(categories.values()) == 92
    assert next(iter(categories.items())) == ("Kitchen utensil", 9)
    assert categories["Bowl"] == 5
    furniture = furniture_counts(dataset)
    assert len(micro_variations(dataset)) == 60
    assert len(macro_layouts(dataset)) == 3
    # S A.1: chairs and beanbags are there more often than once in a layout.
    assert list(furniture.items())[:2] == [("Chair 01", 120), ("Beanbag", 62)]


def episode(number, scene_id=MACRO, **changes):
    """Two objects: a bowl that goes 5 m from a table to the sink, and an apple that stays."""
    goal = (4.0, -2.0, 0.5, 1.0, 0.0, 0.0, 0.0)
    bowl, apple = (1.0, 2.0, *goal[2:]), (0.0, 1.0, *goal[2:])
    target = Rearrangement(object=BOWL, start=TABLE, goal=SINK, world_from_goal=goal)
    robot = RobotStart(base=(0.5, 0.25, 1.0), arm_qpos_rad={})
    values = {"scene_id": scene_id, "seed": number, "robot": robot, "targets": (target,)}
    values |= {"id": f"e{number}", "objects": {BOWL: bowl, APPLE: apple}}
    return Episode(**values | changes)


def episode_set(*episodes, **changes):
    origin = MadeFrom(dataset="0" * 8, objects="embedded", masses="0" * 8, generator=None)
    values = {"env": "HabTidyHouse-v1", "scene_dataset": "tiny", "split": "train", "seed": 0}
    return EpisodeSet(**values | {"made_from": origin, "episodes": episodes} | changes)


def test_episode_statistics():
    held = {"targets": (Rearrangement(object=APPLE, goal=TABLE),), "held": APPLE}
    handle = HandleRef(furniture="fridge_:0000", joint="top_door_hinge", marker="m")
    goal = NavigationGoal(skill="HabPick-v1", base=(3.0, 1.0, 0.0))
    door = {"objects": {}, "targets": (), "handle": handle, "navigation": goal}
    changes = {"v3_sc0_staging_03": {}, "v3_sc1_staging_00": held, "apt_0": door}
    others = (episode(1, scene_id, **values) for scene_id, values in changes.items())
    found = episode_statistics(episode_set(episode(0), *others))
    assert found.objects == {"Bowl": 2, "Apple": 1}
    assert found.clutter == {"Apple": 2, "Bowl": 1}
    assert found.starts == {"Table 01": 2, IN_GRASP: 1}
    assert found.goals == {"Kitchen counter, sink": 2, "Table 01": 1}
    assert found.handles == {"Fridge, top door hinge": 1}
    # From (1, 2) to (4, -2) at one height: sqrt(3^2 + 4^2) = 5. The apple's goal has no pose.
    assert found.distances_m.tolist() == [5.0, 5.0]
    assert found.scenes["sc0"] == ["v3_sc0_staging_00", "v3_sc0_staging_03"]
    assert found.start_m["sc0"].tolist() == [[1.0, 2.0], [1.0, 2.0]]
    assert found.goal_m["sc0"].tolist() == [[4.0, -2.0], [4.0, -2.0]]
    assert found.goal_m["apt_0"].tolist() == [[3.0, 1.0]]
    assert found.robot_m["apt_0"].tolist() == [[0.5, 0.25]]


def test_moved_furniture(tiny):
    turn = {"rotation": [math.cos(0.1), 0, math.sin(0.1), 0]}  # 0.2 rad about the vertical
    tables = [thing("table", [x, 0.4, 2]) for x in (0, 1, 2, 3)]
    variation(tiny, 0, *tables)
    variation(tiny, 1, *tables[::-1])
    variation(tiny, 2, thing("table", [0.04, 0.4, 2]), thing("table", [1.06, 0.4, 2]), *tables[2:])
    variation(tiny, 3, thing("table", [0, 0.4, 2], **turn), *tables[1:], thing("cube", [0, 0.1, 0]))
    dataset = SceneDataset(tiny)
    macro, same, shifted, turned = (load_scene(dataset, s) for s in sorted(dataset.scene_files))
    assert moved_furniture(macro, same) == set(), "the same tables in another order"
    assert moved_furniture(macro, shifted) == {"table_:0001"}, "4 cm are none, 6 cm are"
    assert moved_furniture(macro, turned) == {"table_:0000", "cube_:0000"}


def test_figures_are_written(run, tiny, tmp_path, monkeypatch):
    def refuse(*arguments, **options):
        raise RenderingUnavailableError("No Vulkan device can render images.")

    monkeypatch.setattr(datasets, "resolve_backend", refuse)
    done = run("figures", tiny, "--out", tmp_path / "fewer")
    assert "tiny has no micro-variations: fig06" in done.stdout
    assert not (tmp_path / "fewer/fig06_furniture.png").exists()
    variation(tiny, 1, thing("table", [1, 0.4, 2]))
    write_episodes(episode_set(episode(0)), tmp_path / "tidy.json")
    write_episodes(episode_set(episode(0), env="HabPick-v1"), tmp_path / "pick.json")
    out, files = tmp_path / "out", (tmp_path / "tidy.json", tmp_path / "pick.json")
    done = run("figures", tiny, "--out", out, "--episodes", *files)
    assert done.returncode == 0, done.stderr
    drawn = "fig06_furniture fig07_categories fig08_macro_layouts fig08_micro_variations"
    drawn = ["episodes_HabPick-v1", *drawn.split(), "fig20_tidy_house"]
    assert sorted(file.name for file in out.iterdir()) == [f"{name}.png" for name in drawn]
    assert "fig08 shows floor plans. No Vulkan device" in done.stdout
