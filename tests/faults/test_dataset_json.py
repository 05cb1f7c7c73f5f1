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
    Damage,
    cut,
    folder,
    loop,
    pipe,
    put,
    read_as_env,
    refused_everywhere,
    text,
    whole_dataset,
)

FILES = {
    "config": CONFIG,
    "scene": SCENE,
    "object": TABLE,
    "stage": STAGE,
    "lights": LIGHTS,
    "lexicon": LEXICON,
    "furniture": AO,
}
CONTENTS: dict[str, Damage] = {
    "empty": text(""),
    "blank": text(" \n"),
    "list": text("[]"),
    "number": text("5"),
    "null": text("null"),
    "huge number": text("1" + 400 * "0"),
    "too many digits": text('{"a": 1' + 5000 * "0" + "}"),
    "deep": text(200_000 * "["),
    "deep object": text('{"a":' * 200_000 + "1" + "}" * 200_000),
    "cut": cut(0.5),
    "not utf-8": text(b'{"a": "\xff\xfe"}'),
    "nul bytes": text(b"\0" * 64),
    "web page": text("<html>404</html>"),
    "folder": folder,
    "pipe": pipe,
    "loop": loop,
}

POSE = {
    "two numbers": ([1, 2], "translation is [1, 2]"),
    "four numbers": ([1, 2, 3, 4], "translation"),
    "text": ("here", "translation is 'here'"),
    "a text in it": ([1, "2", 3], "translation"),
    "null in it": ([1, None, 3], "translation"),
    "nested": ([[1, 2, 3]], "translation"),
    "nan": ([1, math.nan, 3], "translation"),
    "infinite": ([1, math.inf, 3], "translation"),
    "far": ([1, 1e9, 3], "translation"),
    "huge": ([1, 10**400, 3], "translation"),
    "true": ([True, 1, 1], "translation"),
    "null": (None, "translation is None"),
}
ROTATIONS = {
    "zero": [0, 0, 0, 0],
    "three": [1, 0, 0],
    "nan": [math.nan, 0, 0, 1],
    "text": "up",
    "euler object": {"x": 1},
}
SCALES = {"nan": math.nan, "zero": 0, "negative": -1, "text": "big", "list": [1, 1, 1], "huge": 1e9}
TABLE_0, CHEST_0 = ("object_instances", 0), ("articulated_object_instances", 0)

VALUES: dict[str, tuple[str, Damage, str]] = {
    **{
        f"pose {k}": (SCENE, put(*TABLE_0, "translation", value=v), w) for k, (v, w) in POSE.items()
    },
    **{
        f"furniture pose {k}": (SCENE, put(*CHEST_0, "translation", value=v), w)
        for k, (v, w) in POSE.items()
    },
    **{
        f"rotation {k}": (SCENE, put(*TABLE_0, "rotation", value=v), "object_instances[0].rotation")
        for k, v in ROTATIONS.items()
    },
    **{
        f"stage rotation {k}": (SCENE, put("stage_instance", "rotation", value=v), "rotation")
        for k, v in ROTATIONS.items()
    },
    **{
        f"scale {k}": (SCENE, put(*TABLE_0, "uniform_scale", value=v), "[0].uniform_scale")
        for k, v in SCALES.items()
    },
    **{
        f"furniture scale {k}": (SCENE, put(*CHEST_0, "uniform_scale", value=v), "uniform_scale")
        for k, v in SCALES.items()
    },
    "no template": (SCENE, put(*TABLE_0, "template_name", value=GONE), "'template_name'"),
    "template number": (SCENE, put(*TABLE_0, "template_name", value=5), "template_name is 5"),
    "template empty": (SCENE, put(*TABLE_0, "template_name", value=""), "template_name is ''"),
    "template unknown": (SCENE, put(*TABLE_0, "template_name", value="tables"), "'table'"),
    "template a path": (SCENE, put(*TABLE_0, "template_name", value="../../.."), "Unknown"),
    "furniture unknown": (SCENE, put(*CHEST_0, "template_name", value="chst"), "'chest'"),
    "furniture number": (SCENE, put(*CHEST_0, "template_name", value=1.5), "template_name is 1.5"),
    "motion number": (SCENE, put(*TABLE_0, "motion_type", value=1), "motion_type is 1"),
    "motion unknown": (SCENE, put(*TABLE_0, "motion_type", value="STATC"), "'STATIC'"),
    "objects object": (SCENE, put("object_instances", value={}), "object_instances is {}"),
    "objects null": (SCENE, put("object_instances", value=None), "object_instances is None"),
    "objects text": (SCENE, put("object_instances", value="table"), "object_instances"),
    "object number": (SCENE, put(*TABLE_0, value=3), "object_instances[0] is 3"),
    "object list": (SCENE, put(*TABLE_0, value=[]), "object_instances[0] is []"),
    "furniture list": (SCENE, put(*CHEST_0, value=[]), "articulated_object_instances[0]"),
    "furniture object": (SCENE, put(CHEST_0[0], value={"a": 1}), "a list"),
    "no stage": (SCENE, put("stage_instance", value=GONE), "'stage_instance'"),
    "stage text": (SCENE, put("stage_instance", value="room"), "stage_instance is 'room'"),
    "stage nameless": (SCENE, put("stage_instance", value={}), "'template_name'"),
    "stage number": (SCENE, put("stage_instance", "template_name", value=7), "template_name is 7"),
    "lighting number": (SCENE, put("default_lighting", value=5), "default_lighting is 5"),
    "lighting list": (SCENE, put("default_lighting", value=["sun"]), "default_lighting"),
    "lighting null": (SCENE, put("default_lighting", value=None), "default_lighting is None"),
    "lighting unknown": (SCENE, put("default_lighting", value="lighting/sum"), "'sun'"),
    # Object templates
    **{
        f"mass {k}": (TABLE, put("mass", value=v), "mass is")
        for k, v in {**SCALES, "heavy": "heavy", "null": None, "true": True}.items()
    },
    "no mesh": (TABLE, put("render_asset", value=GONE), "'render_asset'"),
    "mesh number": (TABLE, put("render_asset", value=3), "render_asset is 3"),
    "mesh empty": (TABLE, put("render_asset", value=""), "render_asset is ''"),
    "mesh folder": (TABLE, put("render_asset", value="."), "a folder"),
    "mesh nul": (TABLE, put("render_asset", value="a\0b"), "render_asset"),
    "mesh long": (TABLE, put("render_asset", value="a" * 5000), "name too long"),
    "collision number": (TABLE, put("collision_asset", value=3), "collision_asset is 3"),
    "collision folder": (TABLE, put("collision_asset", value="../.."), "a folder"),
    "collision list": (TABLE, put("collision_asset", value=["a.glb"]), "collision_asset"),
    "friction nan": (TABLE, put("friction_coefficient", value=math.nan), "friction_coefficient"),
    "friction negative": (TABLE, put("friction_coefficient", value=-1), "friction_coefficient"),
    "friction text": (TABLE, put("friction_coefficient", value="rough"), "is 'rough'"),
    "box text": (CUBE, put("use_bounding_box_for_collision", value="no"), "true or false"),
    "box number": (CUBE, put("use_bounding_box_for_collision", value=1), "true or false"),
    "up zero": (TABLE, put("up", value=[0, 0, 0]), "up is [0, 0, 0]"),
    "up two": (TABLE, put("up", value=[0, 1]), "up is [0, 1]"),
    "semantic text": (TABLE, put("semantic_id", value="table"), "semantic_id"),
    "semantic fraction": (TABLE, put("semantic_id", value=2.5), "semantic_id is 2.5"),
    "user list": (TABLE, put("user_defined", value=[]), "user_defined is []"),
    "category number": (TABLE, put("user_defined", "category", value=4), "category is 4"),
    # Receptacles
    "receptacle text": (TABLE, put("user_defined", RECEPTACLE, value="top"), "is 'top'"),
    **{
        f"receptacle {name} {kind}": (TABLE, put("user_defined", RECEPTACLE, name, value=v), name)
        for name, kind, v in (
            ("name", "number", 5),
            ("name", "list", ["a"]),
            ("name", "null", None),
            ("position", "two", [0, 1]),
            ("position", "nan", [0, math.nan, 0]),
            ("position", "gone", GONE),
            ("scale", "zero", [0.5, 0, 0.3]),
            ("scale", "text", "wide"),
            ("scale", "gone", GONE),
            ("rotation", "zero", [0, 0, 0, 0]),
            ("rotation", "three", [1, 0, 0]),
            ("up", "zero", [0, 0, 0]),
            ("parent_link", "number", 2),
        )
    },
    **{
        f"furniture receptacle {name} {kind}": (
            AO,
            put("user_defined", "receptacle_aabb_in", name, value=v),
            name,
        )
        for name, kind, v in (
            ("scale", "gone", GONE),
            ("scale", "nan", [math.nan, 1, 1]),
            ("position", "gone", GONE),
            ("name", "number", 12),
            ("up", "text", "y"),
        )
    },
    "unknown link": (AO, put("user_defined", "receptacle_aabb_in", "parent_link", value="x"), "/x"),
    "furniture user list": (AO, put("user_defined", value=[1]), "user_defined is [1]"),
    # Stages
    "stage mesh number": (STAGE, put("render_asset", value=1), "render_asset is 1"),
    "stage mesh folder": (STAGE, put("render_asset", value="../../objects"), "a folder"),
    "stage friction nan": (STAGE, put("friction_coefficient", value=math.nan), "friction"),
    "stage friction text": (STAGE, put("friction_coefficient", value="ice"), "is 'ice'"),
    # Lamps
    "lights list": (LIGHTS, put("lights", value=[]), "lights is []"),
    "lamp number": (LIGHTS, put("lights", "a", value=1), "lights.a is 1"),
    **{
        f"lamp {name} {kind}": (LIGHTS, put("lights", "a", name, value=v), f"lights.a.{name}")
        for name, kind, v in (
            ("position", "two", [1, 2]),
            ("position", "nan", [1, math.nan, 2]),
            ("color", "name", "red"),
            ("color", "four", [1, 1, 1, 1]),
            ("intensity", "text", "bright"),
            ("intensity", "nan", math.nan),
            ("intensity", "infinite", math.inf),
            ("type", "number", 0),
        )
    },
    "lamp nowhere": (LIGHTS, put("lights", "a", "position", value=GONE), "'position'"),
    # The lexicon and the dataset's own file
    "classes object": (LEXICON, put("classes", value={}), "classes is {}"),
    "no classes": (LEXICON, put("classes", value=GONE), "'classes'"),
    "class number": (LEXICON, put("classes", 0, value=1), "classes[0] is 1"),
    "class id text": (LEXICON, put("classes", 0, "id", value="3"), "classes[0].id is '3'"),
    "class name number": (LEXICON, put("classes", 0, "name", value=3), "classes[0].name is 3"),
    "section list": (CONFIG, put("stages", value=[]), "stages is []"),
    "paths list": (CONFIG, put("stages", value={"paths": []}), "stages.paths is []"),
    "glob number": (CONFIG, put("objects", value={"paths": {".json": [3]}}), "objects.paths"),
    "glob text": (CONFIG, put("objects", value={"paths": {".json": "a"}}), "a list of folders"),
    "glob empty": (CONFIG, put("scene_instances", value={"paths": {".json": [""]}}), "paths"),
}


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("kind", FILES)
def test_a_file_that_is_no_json_object_is_named(tmp_path, kind, content):
    root = whole_dataset(tmp_path / "data")
    CONTENTS[content](root / FILES[kind])
    refused_everywhere(root, FILES[kind].rpartition("/")[2])


@pytest.mark.parametrize("case", VALUES)
def test_a_value_that_makes_no_sense_is_named(tmp_path, case):
    name, damage, element = VALUES[case]
    root = whole_dataset(tmp_path / "data")
    damage(root / name)
    refused_everywhere(root, name.rpartition("/")[2], element)


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
