"""Invalid JSON files of a dataset, and values of the wrong type or range."""

import math

import pytest
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
    refused_with,
    text,
    whole_dataset,
)
from refusals import check_each

FILES = (CONFIG, SCENE, TABLE, STAGE, LIGHTS, LEXICON, AO)
CONTENTS = {
    "empty": text(""),
    "list": text("[]"),
    "too many digits": text('{"a": 1' + 5000 * "0" + "}"),
    "deep": text(200_000 * "["),
    "cut": cut(0.5),
    "not utf-8": text(b'{"a": "\xff\xfe"}'),
    "folder": folder,
    "pipe": pipe,
    "loop": loop,
}
IN_EVERY_FILE = ("cut", "list", "pipe")

NAN = math.nan
OBJECT, CHEST = ("object_instances", 0), ("articulated_object_instances", 0)
TOP = ("user_defined", RECEPTACLE)
INSIDE = ("user_defined", "receptacle_aabb_in")

# File, place in it, value, words of the message.
VALUES = (
    # Each kind of value, once with all that it does not take
    (SCENE, (*OBJECT, "translation"), [1, 2], "translation is [1, 2]"),
    (SCENE, (*OBJECT, "translation"), [1, 2, 3, 4], "translation"),
    (SCENE, (*OBJECT, "translation"), "here", "translation is 'here'"),
    (SCENE, (*OBJECT, "translation"), [1, "2", 3], "translation"),
    (SCENE, (*OBJECT, "translation"), [1, None, 3], "translation"),
    (SCENE, (*OBJECT, "translation"), [1, NAN, 3], "translation"),
    (SCENE, (*OBJECT, "translation"), [1, math.inf, 3], "translation"),
    (SCENE, (*OBJECT, "translation"), [1, 1e9, 3], "translation"),
    (SCENE, (*OBJECT, "translation"), [1, 10**400, 3], "translation"),
    (SCENE, (*OBJECT, "translation"), [True, 1, 1], "translation"),
    (SCENE, (*OBJECT, "translation"), None, "translation is None"),
    (SCENE, (*OBJECT, "rotation"), [0, 0, 0, 0], "object_instances[0].rotation"),
    (SCENE, (*OBJECT, "rotation"), [1, 0, 0], "object_instances[0].rotation"),
    (SCENE, (*OBJECT, "uniform_scale"), NAN, "[0].uniform_scale"),
    (SCENE, (*OBJECT, "uniform_scale"), 0, "[0].uniform_scale"),
    (SCENE, (*OBJECT, "uniform_scale"), "big", "[0].uniform_scale"),
    (SCENE, (*OBJECT, "uniform_scale"), 1e9, "[0].uniform_scale"),
    (SCENE, (*OBJECT, "template_name"), GONE, "'template_name'"),
    (SCENE, (*OBJECT, "template_name"), 5, "template_name is 5"),
    (SCENE, (*OBJECT, "template_name"), "", "template_name is ''"),
    (SCENE, (*OBJECT, "template_name"), "tables", "'table'"),
    (SCENE, (*OBJECT, "template_name"), "../../..", "Unknown"),
    (SCENE, ("object_instances",), {}, "object_instances is {}"),
    (SCENE, ("object_instances",), None, "object_instances is None"),
    (SCENE, OBJECT, 3, "object_instances[0] is 3"),
    # Each other field of a scene
    (SCENE, (*OBJECT, "motion_type"), 1, "motion_type is 1"),
    (SCENE, (*OBJECT, "motion_type"), "STATC", "'STATIC'"),
    (SCENE, (*CHEST, "translation"), [1, NAN, 3], "translation"),
    (SCENE, (*CHEST, "uniform_scale"), -1, "uniform_scale"),
    (SCENE, (*CHEST, "template_name"), "chst", "'chest'"),
    (SCENE, CHEST, [], "articulated_object_instances[0]"),
    (SCENE, CHEST[:1], {"a": 1}, "a list"),
    (SCENE, ("stage_instance", "rotation"), [0, 0, 0, 0], "rotation"),
    (SCENE, ("stage_instance",), GONE, "'stage_instance'"),
    (SCENE, ("stage_instance",), "room", "stage_instance is 'room'"),
    (SCENE, ("stage_instance", "template_name"), 7, "template_name is 7"),
    (SCENE, ("default_lighting",), 5, "default_lighting is 5"),
    (SCENE, ("default_lighting",), "lighting/sum", "'sun'"),
    # Object templates
    (TABLE, ("mass",), 0, "mass is"),
    (TABLE, ("mass",), None, "mass is"),
    (TABLE, ("mass",), True, "mass is"),
    (TABLE, ("render_asset",), GONE, "'render_asset'"),
    (TABLE, ("render_asset",), 3, "render_asset is 3"),
    (TABLE, ("render_asset",), ".", "a folder"),
    (TABLE, ("render_asset",), "a\0b", "render_asset"),
    (TABLE, ("render_asset",), "a" * 5000, "name too long"),
    (TABLE, ("collision_asset",), ["a.glb"], "collision_asset"),
    (TABLE, ("collision_asset",), "../..", "a folder"),
    (TABLE, ("friction_coefficient",), -1, "friction_coefficient"),
    (TABLE, ("friction_coefficient",), "rough", "is 'rough'"),
    (CUBE, ("use_bounding_box_for_collision",), "no", "true or false"),
    (CUBE, ("use_bounding_box_for_collision",), 1, "true or false"),
    (TABLE, ("up",), [0, 0, 0], "up is [0, 0, 0]"),
    (TABLE, ("semantic_id",), "table", "semantic_id"),
    (TABLE, ("semantic_id",), 2.5, "semantic_id is 2.5"),
    (TABLE, ("user_defined",), [], "user_defined is []"),
    (TABLE, ("user_defined", "category"), 4, "category is 4"),
    # Receptacles
    (TABLE, TOP, "top", "is 'top'"),
    (TABLE, (*TOP, "name"), ["a"], "name"),
    (TABLE, (*TOP, "position"), [0, NAN, 0], "position"),
    (TABLE, (*TOP, "position"), GONE, "position"),
    (TABLE, (*TOP, "scale"), [0.5, 0, 0.3], "scale"),
    (TABLE, (*TOP, "scale"), GONE, "scale"),
    (TABLE, (*TOP, "rotation"), [1, 0, 0], "rotation"),
    (TABLE, (*TOP, "up"), [0, 0, 0], "up"),
    (TABLE, (*TOP, "parent_link"), 2, "parent_link"),
    (AO, (*INSIDE, "scale"), [NAN, 1, 1], "scale"),
    (AO, (*INSIDE, "position"), GONE, "position"),
    (AO, (*INSIDE, "parent_link"), "x", "/x"),
    (AO, ("user_defined",), [1], "user_defined is [1]"),
    # Stages and lamps
    (STAGE, ("render_asset",), 1, "render_asset is 1"),
    (STAGE, ("render_asset",), "../../objects", "a folder"),
    (STAGE, ("friction_coefficient",), NAN, "friction"),
    (LIGHTS, ("lights",), [], "lights is []"),
    (LIGHTS, ("lights", "a"), 1, "lights.a is 1"),
    (LIGHTS, ("lights", "a", "position"), [1, 2], "lights.a.position"),
    (LIGHTS, ("lights", "a", "position"), GONE, "'position'"),
    (LIGHTS, ("lights", "a", "color"), "red", "lights.a.color"),
    (LIGHTS, ("lights", "a", "intensity"), math.inf, "lights.a.intensity"),
    (LIGHTS, ("lights", "a", "type"), 0, "lights.a.type"),
    # The lexicon and the dataset's own file
    (LEXICON, ("classes",), {}, "classes is {}"),
    (LEXICON, ("classes",), GONE, "'classes'"),
    (LEXICON, ("classes", 0), 1, "classes[0] is 1"),
    (LEXICON, ("classes", 0, "id"), "3", "classes[0].id is '3'"),
    (LEXICON, ("classes", 0, "name"), 3, "classes[0].name is 3"),
    (CONFIG, ("stages",), [], "stages is []"),
    (CONFIG, ("stages",), {"paths": []}, "stages.paths is []"),
    (CONFIG, ("objects",), {"paths": {".json": [3]}}, "objects.paths"),
    (CONFIG, ("objects",), {"paths": {".json": "a"}}, "a list of folders"),
    (CONFIG, ("scene_instances",), {"paths": {".json": [""]}}, "paths"),
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

    check_each({repr(case[:3])[:120]: case for case in VALUES}, check)


def test_the_whole_dataset_is_in_order(tmp_path):
    spec = read_as_env(whole_dataset(tmp_path / "data"))
    assert len(spec.objects) == 2
    assert len(spec.lights) == 1
    assert {r.name for r in spec.receptacles} == {RECEPTACLE, "receptacle_aabb_in"}
    assert spec.objects[0].template.category == "table"


@pytest.mark.parametrize("lighting", ["", "no_lights"])
def test_a_layout_may_have_no_lamps(tmp_path, lighting):
    root = whole_dataset(tmp_path / "data")
    put("default_lighting", value=lighting)(root / SCENE)
    assert read_as_env(root).lights == ()
