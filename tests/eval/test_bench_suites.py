"""The suites without a reference environment: objects, processes and memory."""

import json
import os

import pytest
import torch
from hab_eval.bench import memory as bench_memory
from hab_eval.bench import object_counts, vector_envs
from hab_eval.bench import processes as bench_vector
from hab_eval.bench import vector as native_vector
from hab_eval.bench.episodes import Generation, generation_rows
from hab_eval.bench.hab_env import actions_of
from hab_eval.bench.layout import SCENE_SUFFIX
from hab_eval.bench.memory import Memory, Reading, further_mb, memory_rows, parse_rollup
from hab_eval.bench.motion import Motion
from hab_eval.bench.objects import object_rows
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.process import StepTiming
from hab_eval.bench.processes import process_row
from hab_eval.bench.suite import GROUP
from hab_eval.bench.suites import find_suite, suite_names
from hab_eval.errors import BenchError

from hab_tasks.episodes import Episode, EpisodeRequest
from hab_tasks.episodes.schema import RobotStart

SCENE = "v3_sc0_staging_00"

ROLLUP = """55d0c0a3e000-7ffc1f5f1000 ---p 00000000 00:00 0                          [rollup]
Rss:              500000 kB
Pss:              300000 kB
Pss_Dirty:        200000 kB
Shared_Clean:     220000 kB
Private_Clean:     10000 kB
Private_Dirty:    200000 kB
"""


def options(suite, tmp_path, **values):
    return BenchOptions(suite=find_suite(suite), scene_dataset=tmp_path, **values)


def episode(held=None):
    start = RobotStart(base=(0.0, 0.0, 0.0), arm_qpos_rad=(0.0,) * 7)
    return Episode(id="", scene_id="", seed=0, robot=start, objects={}, held=held)


def test_every_suite_is_found_under_its_own_name():
    assert {"sim", "vector", "plan"} <= set(suite_names())
    assert [find_suite(name).name for name in suite_names()] == suite_names()


NEW_SUITE = """
from hab_eval.bench.rows import bound_row
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
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "Suite broken (broken_suite:SUITE) cannot be loaded" in done.stderr
    assert not rows.exists()
    done = cli("bench", "--suite", "new", *more, "--steps", 7)
    assert done.returncode == 0, done.stderr
    assert f"7 steps in (('{SCENE}',),)" in done.stdout
    (row,) = json.loads(rows.read_text())["rows"]
    assert row["name"] == "new/s/e/median"


def test_actions_in_their_units():
    motion = Motion(count=3, seed=2, base=True)
    actions = actions_of("ee_base", motion, episode())
    # An entry of 1 moves the hand by 1.5 cm; the base drives 1 m/s and turns 3.14 rad/s.
    assert torch.allclose(0.015 * actions[:, :3], motion.arm_steps_m())
    assert torch.allclose(actions[:, 4:] * torch.tensor([1.0, 3.14]), motion.base_speeds())
    assert actions[:, 3].tolist() == [-1.0] * 3
    assert actions_of("ee", motion, episode(held="bowl_:0000"))[:, 3].tolist() == [1.0] * 3


def test_rows_of_objects_and_processes_by_hand():
    def timing(outside_ms):
        return StepTiming(steps=1000, total_s=1.0 + outside_ms, engine_s=1.0)

    # 10 %, 50 % and 20 % more.
    few, many = [timing(1.0), timing(2.0), timing(1.0)], [timing(1.1), timing(3.0), timing(1.2)]
    growth = object_rows(("a", "b", "c"), {10: few, 100: many})[-1]
    assert (growth.unit, growth.reference_value, growth.n) == ("%", 10.0, 3)
    assert growth.value == pytest.approx(20.0)
    row = process_row(("processes", "a", "b", "c"), [(100.0, 190.0), (100.0, 180.0), (100.0, 50.0)])
    assert (row.name, row.value, row.ratio) == ("processes/a/b/c", 180.0, 1.8)


def test_memory_of_a_process():
    # 500,000 * 1,024 bytes are 512 MB; private is 10,000 + 200,000.
    memory = parse_rollup(ROLLUP)
    assert (memory.rss_mb, memory.pss_mb, memory.uss_mb) == pytest.approx((512.0, 307.2, 215.04))
    memory = bench_memory.read_memory(os.getpid())
    assert 20.0 < memory.uss_mb <= memory.pss_mb <= memory.rss_mb < 10_000.0
    with pytest.raises(BenchError, match="needs Linux"):
        bench_memory.read_memory(2**22 + 1)


def memory(rss_mb, pss_mb, uss_mb):
    return Memory(rss_mb=rss_mb, pss_mb=pss_mb, uss_mb=uss_mb)


def test_memory_of_each_further_environment():
    few = Reading(parent=memory(600, 400, 300), workers=(memory(560, 430, 310),))
    workers = (memory(560, 350, 300), memory(560, 360, 310), memory(560, 370, 320))
    many = Reading(parent=memory(600, 310, 300), workers=workers)
    # 400 + 430 = 830 MB with one, 310 + 350 + 360 + 370 = 1390 MB with three.
    assert further_mb(few, many) == pytest.approx((1390 - 830) / 2)
    rows = {row.name: row for row in memory_rows(("memory", "a", "b"), [(few, many)] * 3)}
    values = {name.split("/")[-1]: (row.value, row.reference_value) for name, row in rows.items()}
    assert values == {
        "one_env_rss": (560.0, 700.0),
        "one_env_pss": (430.0, 560.0),
        "one_env_uss": (310.0, 560.0),
        "further_env_pss": (280.0, 350.0),
        "further_env_uss": (310.0, 350.0),
    }


@pytest.mark.slow
@pytest.mark.assets
def test_episodes_by_object_count_hold_one_another(replica_cad, monkeypatch):
    request = EpisodeRequest(env_id="HabTidyHouse-v1", scene_dataset=replica_cad, scene=SCENE)
    few, some, many = object_counts.episodes_by_object_count(request, (10, 30, 100))
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
    monkeypatch.setattr(object_counts, "AWAY_M", 100.0)  # no floor is that far away
    with pytest.raises(BenchError, match="room for 0 of 2 additional objects"):
        object_counts.episodes_by_object_count(request, (10, 32))


@pytest.mark.slow
@pytest.mark.assets
@pytest.mark.parametrize("way", bench_vector.VECTORS)
def test_processes_step_the_real_environment(replica_cad, way):
    asked = options("processes", replica_cad)
    vector = bench_vector.VECTORS[way](asked, "HabPick-v1", SCENE, 2)
    try:
        assert vector.run_steps(5, seed=0) > 10
        assert len(set(vector.pids())) == 2
        assert all(bench_memory.read_memory(pid).rss_mb > 100 for pid in vector.pids())
    finally:
        vector.close()


@pytest.mark.slow
@pytest.mark.assets
def test_vector_environments_are_measured(replica_cad, monkeypatch):
    monkeypatch.setattr(native_vector, "MANY_ROWS", 4)
    monkeypatch.setattr(native_vector, "ROWS", 4)
    monkeypatch.setattr(vector_envs, "EPISODES", 8)
    asked = options("vector", replica_cad, repeats=1, steps=4, envs=("HabPick-v1",))
    rows = {row.name.rsplit("/", 1)[-1]: row for row in find_suite("vector").run(asked, str)}
    assert set(rows) == {
        "16_rows",
        "16_rows_physics_share",
        "16_rows_outside_physics",
        "16_rows_and_two_processes",
        "64_rows_pss",
        "16_rows_and_maniskill",
    }
    assert all(row.value > 0 and row.reference_value > 0 for row in rows.values())
    assert rows["16_rows_physics_share"].value < 1.0
    assert rows["16_rows_and_maniskill"].ratio > 1.5  # 7 with 16 rows, on an idle machine


def test_generation_is_extrapolated_to_a_whole_set():
    timings = [Generation(episodes=10, cpu_s=2.0, wall_s=1.1)]
    cpu, wall, whole = generation_rows(("episodes", "train", "HabPick-v1"), timings, 0.1)
    assert cpu.name == "episodes/train/HabPick-v1/cpu_per_episode"
    assert (cpu.value, cpu.reference_value, cpu.unit) == (0.2, 0.2, "s")
    assert (wall.value, wall.reference_value) == pytest.approx((0.11, 0.1))
    assert whole.name.endswith("5000_episodes_extrapolated")
    assert (whole.value, whole.reference_value) == pytest.approx((550.0, 500.0))


@pytest.mark.slow
@pytest.mark.assets
def test_generation_is_measured(replica_cad):
    asked = options("episodes", replica_cad, repeats=1, steps=2, envs=("HabOpenDrawer-v1",))
    rows = find_suite("episodes").run(asked, str)
    assert len(rows) == 3
    assert all(0.0 < row.value / row.reference_value < 50.0 for row in rows)
