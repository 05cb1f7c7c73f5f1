"""The three tasks: stages (App. G.2), order of skills (H.1, H.3) and goals, as in the paper."""

from hab_tasks.articulations import DRAWER, FRIDGE
from hab_tasks.registration import TASKS as SPECS
from hab_tasks.tasks.base import Condition, compile_task

TIDY_HOUSE, PREPARE_GROCERIES, SET_TABLE = map(compile_task, SPECS.values())
BOWL, APPLE = 0, 1
IN_DRAWER, IN_FRIDGE = 0, 1


def parts(task):
    """(skill, object, articulation) of each part; for Navigate where to as well."""
    return [
        (p.skill.name, p.object, p.articulation, *([p.to] if p.skill.name == "navigate" else []))
        for p in task.parts
    ]


def moving(number, behind=0):
    return [
        ("navigate", number, behind, "start"),
        ("pick", number, behind),
        ("navigate", number, behind, "goal"),
        ("place", number, behind),
    ]


def test_tidy_house():
    assert TIDY_HOUSE.articulations == ()
    assert parts(TIDY_HOUSE) == [part for number in range(5) for part in moving(number)]
    # "(1) pick object 1, (2) place object 1, (3) pick object 2, etc."
    expected = []
    for n in range(5):
        expected.append((f"pick_{n + 1}", Condition(held=(n,), placed=tuple(range(n)))))
        expected.append((f"place_{n + 1}", Condition(placed=tuple(range(n + 1)))))
    assert list(TIDY_HOUSE.stages.items()) == expected
    assert TIDY_HOUSE.goal == Condition(placed=(0, 1, 2, 3, 4))


def test_prepare_groceries():
    assert PREPARE_GROCERIES.articulations == ()  # everything starts open
    assert parts(PREPARE_GROCERIES) == [part for number in range(3) for part in moving(number)]
    # "(1) pick first fridge object, (2) place it on counter, (3) pick second fridge object,
    # (4) place it on table, (5) pick counter object, (6) place it in fridge"
    assert list(PREPARE_GROCERIES.stages.items()) == [
        ("pick_fridge_1", Condition(held=(0,))),
        ("place_counter", Condition(placed=(0,))),
        ("pick_fridge_2", Condition(held=(1,), placed=(0,))),
        ("place_table", Condition(placed=(0, 1))),
        ("pick_counter", Condition(held=(2,), placed=(0, 1))),
        ("place_fridge", Condition(placed=(0, 1, 2))),
    ]
    assert PREPARE_GROCERIES.goal == Condition(placed=(0, 1, 2))


def test_set_table():
    assert SET_TABLE.articulations == (DRAWER, FRIDGE)
    assert parts(SET_TABLE) == [
        ("navigate", BOWL, IN_DRAWER, "handle"),
        ("open_drawer", BOWL, IN_DRAWER),
        *moving(BOWL, IN_DRAWER),
        ("navigate", BOWL, IN_DRAWER, "handle"),
        ("close_drawer", BOWL, IN_DRAWER),
        ("navigate", APPLE, IN_FRIDGE, "handle"),
        ("open_fridge", APPLE, IN_FRIDGE),
        *moving(APPLE, IN_FRIDGE),
        ("navigate", APPLE, IN_FRIDGE, "handle"),
        ("close_fridge", APPLE, IN_FRIDGE),
    ]
    # "(1) open the drawer, (2) pick the bowl, (3) place it on the table, (4) close the drawer,
    # (5) open the fridge, (6) pick the apple, (7) place it in the bowl, (8) close the fridge"
    assert list(SET_TABLE.stages.items()) == [
        ("open_drawer", Condition(opened=(IN_DRAWER,))),
        ("pick_bowl", Condition(held=(BOWL,))),
        ("place_bowl", Condition(placed=(BOWL,))),
        ("close_drawer", Condition(placed=(BOWL,), closed=(IN_DRAWER,))),
        ("open_fridge", Condition(placed=(BOWL,), opened=(IN_FRIDGE,), closed=(IN_DRAWER,))),
        ("pick_apple", Condition(held=(APPLE,), placed=(BOWL,), closed=(IN_DRAWER,))),
        ("place_apple", Condition(placed=(BOWL, APPLE), closed=(IN_DRAWER,))),
        ("close_fridge", SET_TABLE.goal),
    ]
    # H.1: the goal holds is_closed(fridge) and is_closed(drawer).
    assert SET_TABLE.goal == Condition(placed=(BOWL, APPLE), closed=(IN_DRAWER, IN_FRIDGE))
