"""Invalid JSON files of a dataset, values of the wrong type or range, oversized layouts."""

import math
import tempfile
from pathlib import Path

from builders import tiny_scene, write_scene
from faulty_data import (
    AO,
    CONFIG,
    CUBE,
    GONE,
    LEXICON,
    LIGHTS,
    RECEPTACLE,
    SCENE,
    STAGE,
    TABLE,
    cut,
    folder,
    loop,
    pipe,
    put,
    read_as_env,
    refused_everywhere,
    refused_with,
    text,
    whole_dataset,
)
from refusals import check_each

from hab_tasks.scenes.habitat.load import MOST_FURNITURE

FILES = (CONFIG, SCENE, TABLE, STAGE, LIGHTS, LEXICON, AO)
CONTENTS = {
    "too many digits": text('{"a": 1' + 5000 * "0" + "}"),
    "deep": text(200_000 * "["),
    "not utf-8": text(b'{"a": "\xff\xfe"}'),
    "folder": folder,
    "loop": loop,
    "cut": cut(0.5),
    "list": text("[]"),
    "pipe": pipe,
}
IN_EVERY_FILE = ("cut", "list", "pipe")

NAN = math.nan
OBJECT, CHEST = ("object_instances", 0), ("articulated_object_instances", 0)
TOP = ("user_defined", RECEPTACLE)

# File, place in it, values that it does not take, words of the message.
VALUES = (
    # Each kind of value, once with all that it does not take
    (SCENE, (*OBJECT, "translation"), ([1, 2], [1, "2", 3], [1, NAN, 3]), "translation is"),
    (SCENE, (*OBJECT, "translation"), ([1, 1e9, 3], [1, 10**400, 3], [True, 1, 1], None), "tran"),
    (SCENE, (*OBJECT, "rotation"), ([0, 0, 0, 0], [1, 0, 0]), "object_instances[0].rotation"),
    (SCENE, (*OBJECT, "uniform_scale"), (NAN, 0, "big", 1e9), "[0].uniform_scale"),
    (SCENE, (*OBJECT, "template_name"), (GONE, 5, ""), "template_name"),
    (SCENE, (*OBJECT, "template_name"), ("tables",), "'table'"),
    (SCENE, (*OBJECT, "motion_type"), ("STATC",), "'STATIC'"),
    (SCENE, ("object_instances",), ({}, None), "object_instances is"),
    (SCENE, OBJECT, (3,), "object_instances[0] is 3"),
    (TABLE, ("mass",), (0, None), "mass is"),
    (TABLE, ("render_asset",), ("a\0b", "a" * 5000), "render_asset"),
    (TABLE, ("render_asset",), (".",), "a folder"),
    (TABLE, ("friction_coefficient",), (-1,), "friction_coefficient"),
    (TABLE, ("semantic_id",), ("table", 2.5), "semantic_id"),
    (TABLE, ("up",), ([0, 0, 0],), "up is [0, 0, 0]"),
    (TABLE, ("user_defined",), ([],), "user_defined is []"),
    (CUBE, ("use_bounding_box_for_collision",), (1,), "true or false"),
    # Each other field that has to be a name or in order
    (SCENE, (*CHEST, "translation"), ([1, NAN, 3],), "translation"),
    (SCENE, (*CHEST, "uniform_scale"), (-1,), "uniform_scale"),
    (SCENE, (*CHEST, "template_name"), ("chst",), "'chest'"),
    (SCENE, ("stage_instance",), (GONE,), "stage_instance"),
    (SCENE, ("stage_instance", "rotation"), ([0, 0, 0, 0],), "rotation"),
    (SCENE, ("default_lighting",), ("lighting/sum",), "'sun'"),
    (TABLE, ("collision_asset",), ("../..",), "collision_asset"),
    (TABLE, ("user_defined", "category"), (4,), "category is 4"),
    (TABLE, TOP, ("top",), "is 'top'"),
    (TABLE, (*TOP, "position"), (GONE,), "position"),
    (TABLE, (*TOP, "scale"), ([0.5, 0, 0.3],), "scale"),
    (AO, ("user_defined", "receptacle_aabb_in", "parent_link"), ("x",), "/x"),
    (STAGE, ("render_asset",), ("../../objects",), "render_asset"),
    (LIGHTS, ("lights", "a"), (1,), "lights.a is 1"),
    (LIGHTS, ("lights", "a", "intensity"), (math.inf,), "lights.a.intensity"),
    (LEXICON, ("classes", 0, "id"), ("3",), "classes[0].id is '3'"),
    (CONFIG, ("stages",), ([], {"paths": []}), "stages"),
    (CONFIG, ("objects",), ({"paths": {".json": [3]}}, {"paths": {".json": "a"}}), "objects.paths"),
    (CONFIG, ("scene_instances",), ({"paths": {".json": [""]}},), "paths"),
)


def test_a_file_that_is_no_json_object_is_named(tmp_path):
    cases = {f"{SCENE} {content}": (SCENE, content) for content in CONTENTS}
    cases |= {f"{file} {content}": (file, content) for file in FILES for content in IN_EVERY_FILE}

    def check(case):
        file, content = case
        refused_with(tmp_path, file, CONTENTS[content], file.rpartition("/")[2])

    check_each(cases, check)


def test_a_value_that_makes_no_sense_is_named(tmp_path):
    def check(case):
        file, keys, value, words = case
        refused_with(tmp_path, file, put(*keys, value=value), file.rpartition("/")[2], words)

    cases = [(file, keys, v, words) for file, keys, values, words in VALUES for v in values]
    check_each({repr(case[:3])[:120]: case for case in cases}, check)


def test_the_whole_dataset_is_in_order(tmp_path):
    root = whole_dataset(tmp_path / "data")
    spec = read_as_env(root)
    assert (len(spec.objects), len(spec.lights)) == (2, 1)
    assert {r.name for r in spec.receptacles} == {RECEPTACLE, "receptacle_aabb_in"}
    assert spec.objects[0].template.category == "table"
    put("default_lighting", value="")(root / SCENE)  # a layout may have no lamps
    assert read_as_env(root).lights == ()


def chests(tmp_path, count, step_m):
    """A dataset whose layout has chests in a row."""
    root = whole_dataset(Path(tempfile.mkdtemp(dir=tmp_path)) / "data")
    row = [
        {"template_name": "chest", "translation": [step_m * number, 0.2, 5.0]}
        for number in range(count)
    ]
    write_scene(root, tiny_scene() | {"articulated_object_instances": row})
    return root


def test_too_much_furniture_and_furniture_in_the_place_of_its_twin_is_refused(tmp_path):
    most = chests(tmp_path, MOST_FURNITURE, 1.5)
    assert len(read_as_env(most).articulations) == MOST_FURNITURE
    words = (f"{MOST_FURNITURE + 1} articulated_object_instances", f"at most {MOST_FURNITURE}")
    refused_everywhere(chests(tmp_path, MOST_FURNITURE + 1, 1.5), "scene_instance.json", *words)
    words = ("articulated_object_instances[1]", "chest stands where")
    refused_everywhere(chests(tmp_path, 2, 1e-5), "scene_instance.json", *words)
