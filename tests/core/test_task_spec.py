"""Task declarations: derived properties and errors."""

import pytest

from hab_tasks import Target, TaskSpec, register_task
from hab_tasks.errors import HabError
from hab_tasks.object_names import ALL_OBJECTS, CATEGORIES
from hab_tasks.receptacles import (
    CONTAINERS,
    COUNTER,
    DRAWER,
    ENCLOSED_RECEPTACLES,
    FRIDGE,
    OPEN_RECEPTACLES,
    PHRASES,
    SOFA,
    TABLE_LIGHT,
)
from hab_tasks.registration import TASKS, imported_id, reference_of
from hab_tasks.task_order import interactions
from hab_tasks.task_spec import MOST_OBJECTS


def target(**changes):
    """A target from the sofa to the light table, with changes."""
    return Target(**{"name": "thing", "start": (SOFA,), "goal": (TABLE_LIGHT,), **changes})


def spec(*targets, **changes):
    """A task of these targets, with changes."""
    facts = {"id": "Trial-v1", "instruction": "Move things.", "horizon_steps": 100, **changes}
    return TaskSpec(targets=targets or (target(),), **facts)


CLEAR_TABLE = spec(
    target(name="fruit", objects=("fruit",), start=(TABLE_LIGHT,), goal=(FRIDGE,)),
    target(name="dish", objects=("dish",), start=(TABLE_LIGHT,), goal=COUNTER),
    ends_closed=("fridge",),
)


def order(task):
    """The interactions as text."""
    return [f"{item.kind} {item.articulation or '-'} {item.target}" for item in interactions(task)]


def test_names_are_derived_from_the_id():
    assert (spec(id="HabSetTable-v3").name, spec(id="ClearTable-v1").name) == (
        "set_table",
        "clear_table",
    )
    assert spec(id="HabSetTable-v3").class_name == "HabSetTableEnv"


def test_what_starts_closed_is_opened_before_the_first_object_that_needs_it():
    # The fruit's goal is in the fridge, which is opened with an empty hand and closed after it.
    assert order(CLEAR_TABLE) == [
        "open fridge 0",
        "pick - 0",
        "place fridge 0",
        "close fridge 0",
        "pick - 1",
        "place - 1",
    ]
    two = spec(target(start=(DRAWER,), goal=(FRIDGE,)), ends_closed=("drawer", "fridge"))
    assert order(two) == [
        "open drawer 0",
        "open fridge 0",
        "pick drawer 0",
        "place fridge 0",
        "close drawer 0",
        "close fridge 0",
    ]


def test_what_is_closed_in_the_end_is_closed_after_the_last_object_that_needs_it():
    targets = (
        target(name="first", start=(FRIDGE,)),
        target(name="second"),
        target(name="third", goal=(FRIDGE,)),
    )
    assert order(spec(*targets, ends_closed=("fridge",))) == [
        "open fridge 0",
        "pick fridge 0",
        "place fridge 0",
        "pick - 1",
        "place - 1",
        "pick - 2",
        "place fridge 2",
        "close fridge 2",
    ]
    # What no object needs is closed as well; what is open stays open where nothing asks for more.
    told = spec(starts_open=("drawer",), ends_closed=("drawer",))
    assert order(told) == ["pick - 0", "place - 0", "close drawer 0"]
    moved = target(start=(FRIDGE,))
    assert order(spec(moved, starts_open=("fridge",))) == ["pick - 0", "place - 0"]
    closed = spec(moved, starts_open=("fridge",), ends_closed=("fridge",))
    assert order(closed) == ["pick fridge 0", "place fridge 0", "close fridge 0"]
    assert closed.articulations == ("fridge",)


def test_an_object_inside_another_one_needs_what_that_ones_goal_is_behind():
    targets = (
        target(name="bowl", objects=("024_bowl",), goal=(FRIDGE,)),
        target(name="apple", objects=("013_apple",), goal=(), inside="bowl"),
    )
    assert order(spec(*targets, ends_closed=("fridge",)))[2:] == [
        "place fridge 0",
        "pick - 1",
        "place fridge 1",
        "close fridge 1",
    ]


def test_categories_stand_for_their_objects():
    assert target(objects=("fruit", "026_sponge")).candidates == (
        "013_apple",
        "017_orange",
        "026_sponge",
    )
    assert {name for names in CATEGORIES.values() for name in names} <= set(ALL_OBJECTS)


def test_every_receptacle_has_words():
    assert {*OPEN_RECEPTACLES, *CONTAINERS, *COUNTER} <= set(PHRASES)
    assert not set(ENCLOSED_RECEPTACLES) & set(PHRASES)


IMPOSSIBLE = (
    (
        lambda: spec(target(start=("sofa",))),
        "Unknown name in start of target 'thing' of Trial-v1 'sofa'.",
    ),
    (lambda: spec(target(goal=("moon",))), "Unknown name in goal"),
    (lambda: spec(target(objects=("banana",))), "Unknown name in objects"),
    (lambda: spec(target(start=SOFA)), "a tuple of names is valid"),
    (
        lambda: spec(target(goal=(), inside="thing")),
        "to be inside 'thing', itself; earlier targets are valid (none: it is the first)",
    ),
    (
        lambda: spec(target(goal=(), inside="other"), target(name="other")),
        "earlier targets are valid",
    ),
    (
        lambda: spec(target(name="first"), target(goal=(), inside="cup")),
        "earlier targets are valid (first)",
    ),
    (
        lambda: spec(target(goal=(ENCLOSED_RECEPTACLES[0],))),
        f"{ENCLOSED_RECEPTACLES[0]} is behind a door or in a drawer that no skill opens",
    ),
    (lambda: spec(target(start=(ENCLOSED_RECEPTACLES[1],))), "no skill opens"),
    (lambda: spec(clutter_on=(ENCLOSED_RECEPTACLES[2],)), "no skill opens"),
    (
        lambda: spec(*(target(name=f"t{k}") for k in range(60)), clutter=5),
        f"clutter is 5; whole numbers from 0 to {MOST_OBJECTS - 60} are valid",
    ),
    (lambda: spec(target(inside="x")), "either receptacles as its goal, or `inside`"),
    (lambda: spec(target(goal=())), "either receptacles as its goal, or `inside`"),
    (lambda: spec(target(start=())), "no receptacle to start on"),
    (lambda: spec(target(), target()), "two targets are called 'thing'"),
    (
        lambda: spec(target(stages=("a", "b")), target(name="other", stages=("a", "c"))),
        "two stages are called 'a'",
    ),
    (lambda: spec(target(name="My Thing")), "lower case, digits and underscores"),
    (lambda: spec(id="Trial"), "a name and a version"),
    (lambda: spec(horizon_steps=0), "horizon_steps is 0"),
    (lambda: spec(horizon_steps=1.5), "horizon_steps is 1.5"),
    (lambda: spec(clutter=-1), "clutter is -1"),
    (lambda: spec(clutter_on=()), "names no receptacle for the clutter"),
    (lambda: spec(starts_open=("window",)), "Unknown name in starts_open"),
    (lambda: spec(ends_closed=("chest",)), "Unknown name in ends_closed"),
    (lambda: register_task(spec(id="HabPick-v1")), "another environment has this id"),
    (lambda: register_task(spec(id="HabSetTable-v1")), "another environment has this id"),
)


def test_tasks_that_cannot_be_are_refused_in_one_line():
    wrong = []
    for make, wanted in IMPOSSIBLE:
        with pytest.raises(HabError) as refused:
            make()
        said = str(refused.value)
        if wanted not in said or "\n" in said or ("-v1" not in said and "a version" not in wanted):
            wrong.append((wanted, said))
    assert wrong == []


def test_an_environment_is_known_by_its_module_and_registered_once():
    before = dict(TASKS)
    register_task(TASKS["HabSetTable-v1"])
    assert before == TASKS
    assert imported_id("hab_tasks:HabPick-v1") == "HabPick-v1"
    assert reference_of("HabPick-v1") == "hab_tasks:HabPick-v1"
    assert reference_of("HabSetTable-v1") == "hab_tasks:HabSetTable-v1"
    for reference, wanted in (
        ("no_such_module:Clear-v1", "module 'no_such_module' cannot be imported"),
        ("hab_tasks:Clear-v1", "Unknown environment 'hab_tasks:Clear-v1'"),
        ("Clear-v1", "Unknown environment 'Clear-v1'"),
    ):
        with pytest.raises(HabError, match=wanted):
            imported_id(reference)
