"""Display names of templates, categories and receptacles in figures."""

from hab_tasks.figures.statistics import readable, receptacle_label
from hab_tasks.scenes.habitat.dataset import resolve_dataset
from hab_tasks.scenes.habitat.load import load_scene

PREFIX = "receptacle_aabb_"


def test_names_for_a_reader():
    shown = {
        "frl_apartment_table_03": "Table 03",
        "apartment_bed": "Bed",
        "chestOfDrawers_01": "Chest of drawers 01",
        "024_bowl": "Bowl",
        "tvstand": "TV stand",
        "tv_screen": "TV screen",
        "door2": "Door 2",
        "": "",
    }
    assert {name: readable(name) for name in shown} == shown


def test_receptacles_for_a_reader():
    shown = {
        "Tbl2_Top1_frl_apartment_table_02": "Table 02",
        "Tbl2_Top3_frl_apartment_table_02": "Table 02, top 3",
        "WC1_Top2frl_apartment_wall_cabinet_01": "Wall cabinet 01, top 2",
        "middle_topfrl_apartment_refrigerator": "Refrigerator, middle top",
        "counter_left_kitchen_counter": "Kitchen counter, left",
        "drawer_right_top_frl_apartment_kitchen_counter": "Kitchen counter, drawer right top",
        "shelf_left_top_kitchenCupboard_01": "Kitchen cupboard 01, shelf left top",
        "mine": "Mine",
    }
    assert {name: receptacle_label(PREFIX + name) for name in shown} == shown


def test_all_receptacles_have_names_of_their_own():
    dataset = resolve_dataset("apartment")
    names = {r.name for s in dataset.scene_files for r in load_scene(dataset, s).receptacles}
    assert len({receptacle_label(name) for name in names}) == len(names) > 20
