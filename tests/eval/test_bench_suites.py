"""The suites that compare ours with itself: objects, processes and memory."""

import json
import os
import sys
import typing
from types import SimpleNamespace

import pytest
import stub_bench
import torch
from hab_eval import bench_memory, bench_objects, bench_vector
from hab_eval.bench import PLAN_MODULE, SUITES
from hab_eval.bench_layout import SCENE_SUFFIX
from hab_eval.bench_memory import Memory, Reading, further_mb, memory_rows, parse_rollup
from hab_eval.bench_motion import Motion
from hab_eval.bench_objects import object_rows
from hab_eval.bench_options import DEFAULT_STEPS, BenchOptions
from hab_eval.bench_ours import control_of, motion_of, our_actions
from hab_eval.bench_process import StepTiming
from hab_eval.bench_rows import bound_row
from hab_eval.bench_vector import process_row
from hab_eval.cli import BenchCommand
from hab_eval.errors import BenchError

from hab_tasks.envs import ENVS
from hab_tasks.episodes import Episode
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
    return BenchOptions(suite=suite, scene_dataset=tmp_path, **values)


def episode(held=None):
    start = RobotStart(base=(0.0, 0.0, 0.0), arm_qpos_rad=(0.0,) * 7)
    return Episode(id="", scene_id="", seed=0, robot=start, objects={}, held=held)


def test_every_suite_has_a_name_on_the_command_line():
    hints = typing.get_type_hints(BenchCommand)
    assert typing.get_args(hints["suite"]) == tuple(SUITES) == tuple(DEFAULT_STEPS)


def test_suite_plan_is_the_one_that_the_baseline_brings(cli, tmp_path, monkeypatch):
    asked = []

    def run_plan(options, write_line):
        asked.append(options)
        write_line("planning")
        return [bound_row(["plan", "s", "e", "median"], [0.2], 0.3, unit="s")]

    monkeypatch.setitem(sys.modules, PLAN_MODULE, SimpleNamespace(run_plan=run_plan))
    done = cli(*plan_command(tmp_path), "--steps", 7)
    assert done.returncode == 0, done.stderr
    assert "planning" in done.stdout
    assert (asked[0].suite, asked[0].step_count, asked[0].groups) == ("plan", 7, ((SCENE,),))
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    assert row["name"] == "plan/s/e/median"


@pytest.mark.parametrize("missing", ["hab_spa", PLAN_MODULE])
def test_suite_plan_without_the_baseline(cli, tmp_path, monkeypatch, missing):
    monkeypatch.delitem(sys.modules, PLAN_MODULE, raising=False)
    monkeypatch.setitem(sys.modules, missing, None)  # Python's way to say: not there
    done = cli(*plan_command(tmp_path))
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "there is no 'hab_spa" in done.stderr
    assert "pip install -e baselines/spa" in done.stderr
    assert not (tmp_path / "rows.json").exists()


def plan_command(folder):
    """A command on a dataset of one empty scene."""
    scenes = folder / "data" / "configs" / "scenes"
    scenes.mkdir(parents=True)
    (scenes / f"{SCENE}{SCENE_SUFFIX}").write_text("{}")
    data = ("--scene-dataset", folder / "data")
    return ("bench", "--suite", "plan", *data, "--json", folder / "rows.json")


@pytest.mark.parametrize("env_id", ENVS)
def test_each_environment_moves_what_its_control_mode_moves(env_id):
    control = control_of(env_id)
    assert control in ENVS[env_id].env.control_modes
    motion = motion_of(control, 4, seed=1)
    actions = our_actions(control, motion, episode())
    assert len(actions) == 4
    assert actions.abs().max() <= 1.0
    moved = actions.any(dim=0).tolist()
    # Arm (3), gripper, base (2).
    sizes = {"ee": 4, "ee_base": 6, "base": 2}
    assert moved == [True] * sizes[control]


def test_actions_in_their_units():
    motion = Motion(count=3, seed=2, base=True)
    actions = our_actions("ee_base", motion, episode())
    # An entry of 1 moves the hand by 1.5 cm; the base drives 1 m/s and turns 3.14 rad/s.
    assert torch.allclose(0.015 * actions[:, :3], motion.arm_steps_m())
    assert torch.allclose(actions[:, 4:] * torch.tensor([1.0, 3.14]), motion.base_speeds())
    assert actions[:, 3].tolist() == [-1.0] * 3
    assert our_actions("ee", motion, episode(held="bowl_:0000"))[:, 3].tolist() == [1.0] * 3


def test_objects_are_measured_in_turn(tmp_path):
    side = stub_bench.CountedSide()
    asked = options("objects", tmp_path, repeats=2, steps=7)
    lines = []
    timings = bench_objects.measure(asked, side, lines.append)
    assert [count for count, _ in side.asked] == [10, 30, 100] * 3  # the first round warms up
    seeds = [motion.seed for _, motion in side.asked]
    assert seeds == [0] * 6 + [1] * 3
    assert {motion.count for _, motion in side.asked} == {7}
    assert {count: len(found) for count, found in timings.items()} == {10: 2, 30: 2, 100: 2}
    assert len(lines) == 2


def test_growth_is_that_of_each_round(tmp_path):
    side = stub_bench.CountedSide()
    timings = bench_objects.measure(options("objects", tmp_path, repeats=3), side, lambda _: None)
    rows = {row.name: row for row in object_rows(("objects", "a", "b"), timings)}
    # 1.01 ms outside the engine with 10 objects, 1.1 ms with 100: 8.91 % more, in every round.
    growth = rows["objects/a/b/growth_10_to_100"]
    assert (growth.value, growth.unit, growth.reference_value, growth.n) == (
        pytest.approx(100 * (1.1 / 1.01 - 1)),
        "%",
        10.0,
        3,
    )
    # The middle one of three rounds takes 4 times as long as the one to warm up.
    outside = rows["objects/a/b/30_objects_outside_physics"]
    assert (outside.value, outside.reference_value) == pytest.approx((4 * 1.03, 4 * 1.01))
    assert outside.reference == "10 objects"
    share = rows["objects/a/b/100_objects_physics_share"]
    assert share.value == pytest.approx(1 / (1 + 4 * 1.1))


def test_growth_is_found_where_there_is_some():
    def timing(outside_ms):
        return StepTiming(steps=1000, total_s=1.0 + outside_ms, engine_s=1.0)

    # 10 %, 50 % and 20 % more.
    few, many = [timing(1.0), timing(2.0), timing(1.0)], [timing(1.1), timing(3.0), timing(1.2)]
    assert object_rows(("a", "b", "c"), {10: few, 100: many})[-1].value == pytest.approx(20.0)


def test_processes_are_measured_in_turn(tmp_path):
    calls = []
    one, two = stub_bench.Vector(1, calls), stub_bench.Vector(2, calls)
    asked = options("processes", tmp_path, repeats=2, steps=9)
    pairs = bench_vector.alternate(asked, one, two, lambda _: None)
    warm_up = [(1, "9 steps, seed 0"), (2, "9 steps, seed 0")]
    assert calls == [*warm_up, *warm_up, (1, "9 steps, seed 1"), (2, "9 steps, seed 1")]
    assert pairs == [(100.0, 200.0), (101.0, 201.0)]
    row = process_row(("processes", "a", "b", "c"), [(100.0, 190.0), (100.0, 180.0), (100.0, 50.0)])
    assert (row.name, row.value, row.ratio) == ("processes/a/b/c", 180.0, 1.8)


def test_kernel_counts_in_kibibytes():
    # 500,000 * 1,024 bytes are 512 MB; private is 10,000 + 200,000.
    memory = parse_rollup(ROLLUP)
    assert (memory.rss_mb, memory.pss_mb, memory.uss_mb) == pytest.approx((512.0, 307.2, 215.04))


def test_memory_of_this_process():
    memory = bench_memory.read_memory(os.getpid())
    assert 20.0 < memory.uss_mb <= memory.pss_mb <= memory.rss_mb < 10_000.0
    with pytest.raises(BenchError, match="needs Linux"):
        bench_memory.read_memory(2**22 + 1)


def test_memory_of_each_further_environment():
    parent = stub_bench.memory(600.0, 400.0, 300.0)
    few = Reading(parent=parent, workers=(stub_bench.memory(560.0, 430.0, 310.0),))
    less = stub_bench.memory(600.0, 310.0, 300.0)
    workers = [
        stub_bench.memory(560.0, pss, uss) for pss, uss in ((350, 300), (360, 310), (370, 320))
    ]
    many = Reading(parent=less, workers=tuple(workers))
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
    assert {row.unit for row in rows.values()} == {"MB"}


def test_memory_is_read_of_new_processes_each_time(tmp_path):
    calls = []
    asked = options("memory", tmp_path, repeats=2, steps=4)
    pairs = bench_memory.measure(asked, lambda size: stub_bench.Vector(size, calls), lambda _: None)
    first = [(1, "4 steps, seed 0"), (1, "close"), (3, "4 steps, seed 0"), (3, "close")]
    again = [(1, "4 steps, seed 1"), (1, "close"), (3, "4 steps, seed 1"), (3, "close")]
    assert calls == [(1, "close"), *first, *again]
    assert [(len(few.workers), len(many.workers)) for few, many in pairs] == [(1, 3)] * 2
    assert isinstance(pairs[0][0].parent, Memory)


@pytest.mark.slow
@pytest.mark.assets
def test_crowded_episodes_hold_one_another(replica_cad, monkeypatch):
    from hab_eval import bench_crowd

    from hab_tasks.episodes import EpisodeRequest

    request = EpisodeRequest(
        env_id="HabTidyHouse-v1", scene_dataset=replica_cad, scene="v3_sc0_staging_00"
    )
    few, some, many = bench_crowd.crowded_episodes(request, (10, 30, 100))
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
    monkeypatch.setattr(bench_crowd, "AWAY_M", 100.0)  # no floor is that far away
    with pytest.raises(BenchError, match="room for 0 further objects, not for 2"):
        bench_crowd.crowded_episodes(request, (10, 32))


@pytest.mark.slow
@pytest.mark.assets
@pytest.mark.parametrize("way", bench_vector.WAYS)
def test_processes_step_the_real_environment(replica_cad, way):
    asked = options("processes", replica_cad)
    vector = bench_vector.WAYS[way](asked, "HabPick-v1", "v3_sc0_staging_00", 2)
    try:
        assert vector.run_steps(5, seed=0) > 10
        assert len(set(vector.pids())) == 2
        assert all(bench_memory.read_memory(pid).rss_mb > 100 for pid in vector.pids())
    finally:
        vector.close()
