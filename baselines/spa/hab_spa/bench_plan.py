"""Suite plan of ``hab-eval bench``: planning time of the arm, and speed-up by its collision model.

A plan consists of the steps of Pick before it moves: collision model, joint goals and a path. The
planner ``batched`` is compared with OMPL in alternation, in total and by step. Another reference is
OMPL's search with collision checks in the simulator (`hab_spa.planning.validity`), by ManiSkill's
`set_state_dict`; a second one sets only the arm's joints. All three agree on the poses, so their
searches are identical. The time of these references is therefore computed: number of checks, times
its time per check on poses of the same search, plus the plan's remaining time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from hab_eval.bench.report import BenchRow, bound_row, make_row
from hab_eval.bench.suite import PICK, BenchOptions, Suite, WriteLine
from numpy.typing import NDArray

from hab_spa.bench_episode import episode_rows
from hab_spa.motion.robot import SpaConfig
from hab_spa.planning.arm_plan import PLANNERS
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.joint_goal import sample_reaching_goals
from hab_spa.planning.validity import (
    Agreement,
    SimulatorCheck,
    StateDictCheck,
    agreement,
    kernel_agreement,
)
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.shapes import Array
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes
from hab_tasks.privileged import PrivilegedState
from hab_tasks.robots.spec import RobotSpec

MEDIAN_BOUND_S, MOST_BOUND_S, SPEEDUP_BOUND, AGREEMENT_BOUND_PERCENT = 0.3, 2.0, 20.0, 99.0
BATCHED_MEDIAN_BOUND_S, BATCHED_MOST_BOUND_S, CHECKS_BOUND = 0.009, 0.04, 1e6
MOST_PERCENTILE = 95
TIMED_CHECKS = 100
"""Number of poses of each plan for which the references' checks are timed."""

VALIDITY_POSES, BATCH_POSES, COAL_POSES = 2000, 20_000, 100_000
STATE = "validity by ManiSkill's set_state_dict and a step: checks x measured s per check"
JOINTS = "validity by setting the arm's joints and a step: checks x measured s per check"


@dataclass(frozen=True, kw_only=True)
class PlanSplit:
    """Seconds of one plan by one planner: `ik_s` is part of goals, `simplify_s` of the search."""

    model_s: float
    goals_s: float
    ik_s: float
    search_s: float
    simplify_s: float

    @property
    def total_s(self) -> float:
        """Planning time."""
        return self.model_s + self.goals_s + self.search_s


@dataclass(frozen=True, kw_only=True)
class PlanTiming:
    """Timing of one arm plan.

    Attributes:
        splits: Planner -> its steps.
        checks: Number of collision checks.
        check_s: Time of one check by the collision model.
        joints_check_s: Time of one check by setting the arm's joints in the simulator.
        state_check_s: Time of one check by setting the simulator's whole state.
    """

    splits: Mapping[str, PlanSplit]
    checks: int
    check_s: float
    joints_check_s: float
    state_check_s: float

    @property
    def seconds(self) -> float:
        """Planning time of OMPL [s]."""
        return self.splits["ompl"].total_s

    def with_checks_of(self, check_s: float) -> float:
        """Returns the planning time [s] for another time per check [s]."""
        return self.seconds + self.checks * (check_s - self.check_s)


class _Recorder(ArmCollision):
    """Collision model that records the checked poses."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        self.poses: list[Array] = []
        super().__init__(*args, **settings)

    def free_until(self, poses: Array) -> int:
        """See `ArmCollision`."""
        free = super().free_until(poses)
        self.poses += list(poses[: free + 1])
        return free

    def are_free(self, poses: Array) -> NDArray[np.bool_]:
        """See `ArmCollision`."""
        self.poses += list(poses)
        return super().are_free(poses)


def run_plan(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures plans of HabPick-v1, in the apartment and in each scene, and whole episodes."""
    rows: list[BenchRow] = []
    for name, request in _requests(options):
        env = _make_env(request)
        try:
            episodes = load_episodes(request, options.step_count).episodes
            timings = [_time_plan(env, episode) for episode in episodes]
            write_line(f"suite plan, {name}: {len(timings)} plans")
            rows += split_rows(("plan", name, PICK), timings)
            _reset(env, episodes[0])
            core = env.unwrapped
            rows += batch_rows(("plan", name, PICK), core.robot, core.privileged()[0])
            agreed = agreement(env, VALIDITY_POSES, seed=0)
            rows += plan_rows(("plan", name, PICK), timings, agreed)
        finally:
            env.close()
    return rows + episode_rows(write_line, count=options.steps)


def plan_rows(
    name: tuple[str, str, str], timings: Sequence[PlanTiming], agreed: Agreement
) -> list[BenchRow]:
    """Returns the rows of timings and of the agreement with the simulator."""
    seconds = [timing.seconds for timing in timings]
    most_s = _most(seconds)
    by_state_s = [timing.with_checks_of(timing.state_check_s) for timing in timings]
    by_joints_s = [timing.with_checks_of(timing.joints_check_s) for timing in timings]
    speedups = [by_s / s for by_s, s in zip(by_state_s, seconds, strict=True)]
    check, joints, state = (
        [1e6 * getattr(timing, name) for timing in timings]
        for name in ("check_s", "joints_check_s", "state_check_s")
    )
    near = 100.0 if not agreed.disagreements else 100.0 * (1 - agreed.far / agreed.disagreements)
    return [
        bound_row((*name, "median"), seconds, MEDIAN_BOUND_S, unit="s/plan"),
        bound_row((*name, f"percentile_{MOST_PERCENTILE}"), [most_s], MOST_BOUND_S, unit="s/plan"),
        make_row((*name, "state_set"), seconds, by_state_s, unit="s/plan", reference=STATE),
        bound_row((*name, "speedup"), speedups, SPEEDUP_BOUND, unit="x fewer s (checks x s/check)"),
        make_row((*name, "joints_set"), seconds, by_joints_s, unit="s/plan", reference=JOINTS),
        make_row((*name, "check_state"), check, state, unit="us/check", reference=STATE),
        make_row((*name, "check_joints"), check, joints, unit="us/check", reference=JOINTS),
        bound_row((*name, "validity"), [agreed.percent], AGREEMENT_BOUND_PERCENT, unit="% agree"),
        bound_row((*name, "validity_near"), [near], 100.0, unit="% of the others within 1 cm"),
    ]


def _requests(options: BenchOptions) -> Iterator[tuple[str, EpisodeRequest]]:
    yield "apartment", EpisodeRequest(env_id=PICK, scene_dataset="apartment")
    objects = None if options.objects is None else str(options.objects)
    for (scene,) in options.groups:
        dataset = str(options.scene_dataset)
        yield (
            scene,
            EpisodeRequest(env_id=PICK, scene_dataset=dataset, objects=objects, scene=scene),
        )


def _make_env(request: EpisodeRequest) -> Any:
    return gym.make(
        f"hab_tasks:{request.env_id}",
        num_envs=1,
        scene_dataset=request.scene_dataset,
        objects=request.objects,
        obs_mode="state_dict",
        render_backend="none",
    )


def _reset(env: Any, episode: Episode) -> None:
    env.reset(seed=episode.seed, options={"episode": episode, "reconfigure": False})


def _time_plan(env: Any, episode: Episode) -> PlanTiming:
    """Times plans, then checks by each method; the simulator last, as its state changes."""
    _reset(env, episode)
    core = env.unwrapped
    scene, state = TrueScene(core.robot), core.privileged()[0]
    scene.see({"privileged": [state]}, 0)
    make = lambda kind: kind(core.robot, state, held=state.held)  # noqa: E731
    make(ArmCollision)  # prepares shapes, which persist across the episodes of a layout
    splits = {
        name: _split(
            scene,
            lambda: make(ArmCollision),
            SpaConfig().planned_by(name, core.robot),
            episode.seed,
        )
        for name in PLANNERS
    }
    recorder = make(_Recorder)
    _split(scene, lambda: recorder, SpaConfig(), episode.seed)
    asked = np.linspace(0, len(recorder.poses) - 1, TIMED_CHECKS).astype(int)
    poses = [recorder.poses[i] for i in asked] if recorder.poses else []
    return PlanTiming(
        splits=splits,
        checks=len(recorder.poses),
        check_s=_check_s(make(ArmCollision), poses),
        joints_check_s=_check_s(SimulatorCheck(env), poses),
        state_check_s=_check_s(StateDictCheck(env), poses),
    )


def _split(
    scene: TrueScene, make: Callable[[], ArmCollision], config: SpaConfig, seed: int
) -> PlanSplit:
    """Plans a path to the episode's object, as Pick does."""
    arm, spent_s, found = config.kinematics(scene.robot), [0.0], None
    solve = arm.solve

    def timed(*args: Any, **settings: Any) -> Any:
        before = time.perf_counter()
        result = solve(*args, **settings)
        spent_s[0] += time.perf_counter() - before
        return result

    arm.solve = timed
    began = time.perf_counter()
    collision = make()
    made = time.perf_counter()
    points_m = scene.grasp_points_m(0)
    goals = sample_reaching_goals(points_m, collision, arm, seed, config.goal)
    sampled = time.perf_counter()
    if len(goals):
        found = config.planner.plan(scene.arm_qpos, goals, collision, seed=seed, limits=config.plan)
    return PlanSplit(
        model_s=made - began,
        goals_s=sampled - made,
        ik_s=spent_s[0],
        search_s=time.perf_counter() - sampled,
        simplify_s=0.0 if found is None else found.simplify_s,
    )


def batch_rows(
    name: tuple[str, str, str], robot: RobotSpec, state: PrivilegedState
) -> list[BenchRow]:
    """Returns the rate of checks in batches, and their agreement with coal."""
    model = ArmCollision(robot, state, held=state.held)
    shape = BATCH_POSES, len(robot.arm_joints)
    poses = np.random.default_rng(0).uniform(*model.limits_rad, shape)
    model.are_free(poses)
    began = time.perf_counter()
    model.are_free(poses)
    rate = BATCH_POSES / (time.perf_counter() - began)
    count, others, false_free = kernel_agreement(model, COAL_POSES, seed=0)
    agree = 100.0 * (1.0 - others / count)
    return [
        bound_row((*name, "batch_checks"), [rate], CHECKS_BOUND, unit="checks/s"),
        bound_row((*name, "coal"), [agree], 100.0, unit=f"% of {count} poses agree"),
        bound_row((*name, "false_free"), [100.0 - 100.0 * false_free / count], 100.0, unit="% not"),
    ]


def split_rows(name: tuple[str, str, str], timings: Sequence[PlanTiming]) -> list[BenchRow]:
    """Returns the rows of the planner ``batched``, in total and by step, compared with OMPL."""
    rows = []
    for part in ("total", "model", "goals", "ik", "search", "simplify"):
        ours, reference = (
            [1e3 * getattr(timing.splits[planner], f"{part}_s") for timing in timings]
            for planner in ("batched", "ompl")
        )
        for kind, of in (("median", np.median), ("percentile_95", _most), ("mean", np.mean)):
            pair = [[max(float(of(times)), 1e-6)] for times in (ours, reference)]
            label = f"batched_{part}_{kind}"
            rows.append(make_row((*name, label), *pair, unit="ms/plan", reference="planner ompl"))
    seconds = [timing.splits["batched"].total_s for timing in timings]
    bounds = ("batched_median", seconds, BATCHED_MEDIAN_BOUND_S), (
        *("batched_percentile_95", [_most(seconds)]), BATCHED_MOST_BOUND_S)  # fmt: skip
    return rows + [bound_row((*name, row), s, bound, unit="s/plan") for row, s, bound in bounds]


def _most(values: Sequence[float]) -> float:
    return float(np.percentile(values, MOST_PERCENTILE))


def _check_s(collision: ArmCollision | SimulatorCheck, poses: Sequence[Array]) -> float:
    """Returns the mean time of one check [s]; 0 for no poses."""
    began = time.perf_counter()
    for pose in poses:
        collision.is_free(pose)
    return (time.perf_counter() - began) / max(1, len(poses))


SUITE = Suite(name="plan", run=run_plan, steps=100)
