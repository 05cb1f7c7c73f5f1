"""Task declarations: derived properties and errors."""

from dataclasses import MISSING, fields, replace

import numpy as np
import pytest
from refusals import refused_by_call

from hab_tasks import Target, TaskSpec, register_task
from hab_tasks.errors import HabError
from hab_tasks.object_names import ALL_OBJECTS, CATEGORIES
from hab_tasks.receptacles import DRAWER, ENCLOSED_RECEPTACLES, FRIDGE, SOFA, TABLE_LIGHT
from hab_tasks.registration import TASKS, imported_id, reference_of
from hab_tasks.task_spec import MOST_OBJECTS, interactions


def target(**changes):
    """A target from the sofa to the light table, with changes."""
    return Target(**{"name": "thing", "start": (SOFA,), "goal": (TABLE_LIGHT,), **changes})


def spec(*targets, **changes):
    """A task of these targets, with changes."""
    facts = {"id": "Trial-v1", "instruction": "Move things.", "horizon_steps": 100, **changes}
    return TaskSpec(targets=targets or (target(),), **facts)


def order(task):
    """The interactions: what is done, through which front, with the number of which target."""
    found = interactions(task)
    return ", ".join(f"{item.kind} {item.articulation or '-'} {item.target}" for item in found)


def test_fronts_are_opened_before_the_first_object_and_closed_after_the_last_that_needs_them():
    # The fridge is opened with an empty hand.
    fruit, dish = target(name="fruit", goal=(FRIDGE,)), target(name="dish")
    wanted = "open fridge 0, pick - 0, place fridge 0, close fridge 0, pick - 1, place - 1"
    assert order(spec(fruit, dish, ends_closed=("fridge",))) == wanted
    both = spec(target(start=(DRAWER,), goal=(FRIDGE,)), ends_closed=("drawer", "fridge"))
    wanted = "open drawer 0, open fridge 0, pick drawer 0, place fridge 0"
    assert order(both) == wanted + ", close drawer 0, close fridge 0"
    last = target(name="last", goal=(FRIDGE,))
    wanted = "open fridge 0, pick - 0, place fridge 0, pick - 1, place - 1, pick - 2"
    task = spec(fruit, dish, last, ends_closed=("fridge",))
    assert order(task) == wanted + ", place fridge 2, close fridge 2"
    # What no object needs is closed as well; what is open stays open where nothing asks for more.
    told = spec(starts_open=("drawer",), ends_closed=("drawer",))
    assert order(told) == "pick - 0, place - 0, close drawer 0"
    moved = target(start=(FRIDGE,))
    assert order(spec(moved, starts_open=("fridge",))) == "pick - 0, place - 0"
    closed = spec(moved, starts_open=("fridge",), ends_closed=("fridge",))
    assert order(closed) == "pick fridge 0, place fridge 0, close fridge 0"
    assert closed.articulations == ("fridge",)


def test_an_object_inside_another_one_needs_what_that_ones_goal_is_behind():
    bowl, apple = target(name="bowl", goal=(FRIDGE,)), target(name="apple", goal=(), inside="bowl")
    wanted = "open fridge 0, pick - 0, place fridge 0, pick - 1, place fridge 1, close fridge 1"
    assert order(spec(bowl, apple, ends_closed=("fridge",))) == wanted


def test_categories_stand_for_their_objects():
    both = target(objects=("fruit", "026_sponge"))
    assert both.candidates == ("013_apple", "017_orange", "026_sponge")
    assert {name for names in CATEGORIES.values() for name in names} <= set(ALL_OBJECTS)


SHUT_IN = ENCLOSED_RECEPTACLES[0]


def test_tasks_that_cannot_be_are_refused_in_one_line():
    cases = (
        (lambda: spec(target(start=("sofa",))), "in start of target 'thing' of Trial-v1 'sofa'"),
        (lambda: spec(target(objects=("banana",))), "Unknown name in objects"),
        (lambda: spec(target(goal=(), inside="thing")), "inside 'thing', itself"),
        (lambda: spec(target(goal=(), inside="cup")), "earlier targets are valid"),
        (lambda: spec(target(goal=(SHUT_IN,))), f"{SHUT_IN} is behind a door"),
        (lambda: spec(clutter_on=(SHUT_IN,)), "no skill opens"),
        (lambda: spec(clutter=MOST_OBJECTS), f"from 0 to {MOST_OBJECTS - 1} are valid"),
        (lambda: spec(target(inside="x")), "either receptacles as its goal, or `inside`"),
        (lambda: spec(target(start=())), "no receptacle to start on"),
        (lambda: spec(target(), target()), "two targets are called 'thing'"),
        (lambda: spec(target(stages=("a", "a"))), "two stages are called 'a'"),
        (lambda: spec(id="Trial"), "a name and a version"),
        (lambda: spec(clutter_on=()), "names no receptacle for the clutter"),
        (lambda: register_task(spec(id="HabSetTable-v1"), "me"), "another environment has this id"),
        (lambda: register_task(spec(id="CartPole-v1"), "me"), "another environment has this id"),
        (lambda: register_task(None, "me"), "a TaskSpec is valid, not a NoneType"),
        (lambda: spec(target(stages=("a",))), "stages of target 'thing' is ('a',); None or two"),
        (
            lambda: spec(target(stages=("close_fridge", "a"))),
            "two stages are called 'close_fridge'",
        ),
        (lambda: spec(*[target(name=f"a{i}") for i in range(100)]), "100 targets; from 1 to 64"),
    )
    for make, words in cases:
        refused_by_call(make, words)


def test_values_of_the_wrong_type_are_refused_in_one_line():
    fine = {"clutter": 5, "horizon_steps": 5, "instruction": "abc", "name": "abc"}
    odd = (None, 5, "abc", ("a", None), [[]], {"a": 1}, {"a"}, 2.5, b"a", "é" * 99, "a\nb", Target)
    for value in odd:
        for field in fields(TaskSpec):
            if fine.get(field.name) != value and (field.name, value) != ("instruction", "é" * 99):
                refused_by_call(lambda f=field.name, v=value: replace(spec(), **{f: v}))
        for field in fields(Target):
            if fine.get(field.name) != value and (value is not None or field.default is MISSING):
                refused_by_call(lambda f=field.name, v=value: spec(target(**{f: v})))


def test_lists_and_numpys_numbers_are_taken():
    as_list = TaskSpec(
        id="Trial-v1",
        instruction="Move things.",
        horizon_steps=np.int64(100),
        targets=[target(start=[SOFA], stages=["grab", "put"])],
        ends_closed=["fridge"],
    )
    assert hash(as_list) == hash(spec(target(stages=("grab", "put")), ends_closed=("fridge",)))


def test_an_environment_is_known_by_its_module_and_registered_once():
    before = dict(TASKS)
    register_task(TASKS["HabSetTable-v1"], __name__)
    assert before == TASKS
    assert imported_id("hab_tasks:HabPick-v1") == "HabPick-v1"
    assert reference_of("HabPick-v1") == "hab_tasks:HabPick-v1"
    for reference, wanted in (
        ("no_such_module:Clear-v1", "module 'no_such_module' cannot be imported"),
        ("hab_tasks:Clear-v1", "Unknown environment 'hab_tasks:Clear-v1'"),
    ):
        with pytest.raises(HabError, match=wanted):
            imported_id(reference)
