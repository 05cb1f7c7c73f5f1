"""Suites by name, and those of objects and vector environments."""

import json

import pytest
from hab_eval.bench import regressions
from hab_eval.bench import vector as native_vector
from hab_eval.bench.reference import SCENE_SUFFIX
from hab_eval.bench.suite import GROUP, BenchOptions, find_suite, suite_names
from hab_eval.errors import BenchError

from hab_tasks.episodes import EpisodeRequest

SCENE = "v3_sc0_staging_00"


def options(suite, tmp_path, **values):
    return BenchOptions(suite=find_suite(suite), scene_dataset=tmp_path, **values)


def test_every_suite_is_found_under_its_own_name():
    assert {"sim", "vector", "plan"} <= set(suite_names())
    assert [find_suite(name).name for name in suite_names()] == suite_names()


NEW_SUITE = """
from hab_eval.bench.report import bound_row
from hab_eval.bench.suite import Suite

def run(options, write_line):
    write_line(f"{options.step_count} steps in {options.groups}")
    return [bound_row(["new", "s", "e", "median"], [0.2], 0.3, unit="s")]

SUITE = Suite(name="new", run=run, steps=3)
"""


def install(folder, name, module, text):
    """Puts a module, and the entry point that its package would have, on the path."""
    (folder / f"{module}.py").write_text(text, encoding="utf-8")
    about = folder / f"{module}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{GROUP}]\n{name} = {module}:SUITE\n")


def test_a_new_suite_is_a_file_and_an_entry_point(cli, tmp_path, monkeypatch):
    scenes = tmp_path / "data" / "configs" / "scenes"
    scenes.mkdir(parents=True)
    (scenes / f"{SCENE}{SCENE_SUFFIX}").write_text("{}")
    install(tmp_path, "new", "new_suite", NEW_SUITE)
    install(tmp_path, "broken", "broken_suite", "import no_such_module\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    rows = tmp_path / "rows.json"
    more = ("--scene-dataset", tmp_path / "data", "--json", rows)
    done = cli("bench", "--suite", "broken", *more)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "Suite broken (broken_suite:SUITE) cannot be loaded" in done.stderr
    assert not rows.exists()
    done = cli("bench", "--suite", "new", *more, "--steps", 7)
    assert done.returncode == 0, done.stderr
    assert f"7 steps in (('{SCENE}',),)" in done.stdout
    (row,) = json.loads(rows.read_text())["rows"]
    assert row["name"] == "new/s/e/median"


@pytest.mark.slow
@pytest.mark.assets
def test_episodes_by_object_count_hold_one_another(replica_cad, monkeypatch):
    request = EpisodeRequest(env_id="HabTidyHouse-v1", scene_dataset=replica_cad, scene=SCENE)
    few, some, many = regressions.episodes_by_object_count(request, (10, 30, 100))
    assert [len(e.objects) for e in (few, some, many)] == [10, 30, 100]
    assert few.objects.items() <= some.objects.items() <= many.objects.items()
    assert {target.object for target in many.targets} <= set(few.objects)
    assert few.robot == many.robot
    x, y, _ = many.robot.base
    for handle in set(many.objects) - set(some.objects):
        pose = many.objects[handle]
        # A patch's middle is 1.5 m away or more, its corner 0.21 m nearer.
        assert (pose[0] - x) ** 2 + (pose[1] - y) ** 2 > 1.25**2
        assert -0.05 < pose[2] < 0.2  # on the floor
    monkeypatch.setattr(regressions, "AWAY_M", 100.0)  # no floor is that far away
    with pytest.raises(BenchError, match="room for 0 of 2 additional objects"):
        regressions.episodes_by_object_count(request, (10, 32))


@pytest.mark.slow
@pytest.mark.assets
def test_vector_environments_are_measured(replica_cad, monkeypatch):
    monkeypatch.setattr(native_vector, "MANY_ROWS", 4)
    monkeypatch.setattr(native_vector, "ROWS", 4)
    monkeypatch.setattr(native_vector, "EPISODES", 8)
    asked = options("vector", replica_cad, repeats=1, steps=4, envs=("HabPick-v1",))
    rows = {row.name.rsplit("/", 1)[-1]: row for row in find_suite("vector").run(asked, str)}
    kinds = ("", "_physics_share", "_outside_physics", "_and_two_processes", "_and_maniskill")
    assert set(rows) == {"64_rows_pss", *(f"16_rows{kind}" for kind in kinds)}
    assert all(row.value > 0 and row.reference_value > 0 for row in rows.values())
    assert rows["16_rows_physics_share"].value < 1.0
    assert rows["16_rows_and_maniskill"].ratio > 1.5  # 7 with 16 rows, on an idle machine
