"""Retiming, replay and practice of paths, and the commands that use them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from gymnasium import spaces
from hab_ppo import checkpoint
from hab_ppo.checkpoint import PolicyFileError
from hab_ppo.demonstration_file import Followed, read_examples, write_examples
from hab_ppo.examples import Examples
from hab_ppo.network import new_policy
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.recipe import NetworkConfig
from hab_ppo.recipes import find_recipe
from hab_ppo.replay import Disturbance, Lesson, practise, replay
from hab_ppo.retiming import Follower, Recorded, Stretch, spaced, stretches, within_workspace
from refusals import check_each, refused_by_call

from hab_tasks.robots.fetch import FETCH

STEP_M, LIMIT = 0.015, 60


def line(*xs):
    """Points on the x axis, in centimetres."""
    return np.array([[x / 100, 0.0, 0.0] for x in xs])


def test_a_path_is_split_where_the_gripper_changes_or_the_base_drives():
    grippers = np.array([-1, -1, 1, 1, 1, -0.5])
    drives = np.zeros((6, 2))
    drives[3:5, 0] = 0.4
    path = stretches(Recorded(line(0, 1, 2, 4, 5, 6, 3), grippers, drives))
    assert [one.gripper for one in path] == [-1, 1, 1, -1]
    assert [one.points_m[-1, 0] * 100 for one in path] == pytest.approx([2, 4, 6, 3])
    assert [one.drives is not None for one in path] == [False, False, True, False]
    # Every step of the drive is kept, with the point that it led to.
    assert path[2].points_m[:, 0] * 100 == pytest.approx([5, 6])
    assert path[2].drives[:, 0].tolist() == [0.4, 0.4]


def test_the_base_drives_back_where_the_hand_would_come_too_near():
    pull = Stretch(points_m=line(49, 48, 47, 46, 45, 40.6), gripper=1.0)
    free = Stretch(points_m=line(60, 30), gripper=-1.0)  # an empty hand
    rest = Stretch(points_m=line(45, 50), gripper=-1.0)
    standing, driving, end = within_workspace([free, pull, rest], FETCH)[1:]
    assert standing.points_m[:, 0] * 100 == pytest.approx([49, 48, 47, 46, 45])
    assert standing.drives is None
    # The 4.4 cm from 45 to 40.6 in pieces of at most 2.2 cm: 42.8 and 40.6. The hand stays at 44,
    # so the base is 1.2 cm and then 3.4 cm back: 1.2 and 2.2 of the 3.33 cm that it drives in a
    # step.
    assert driving.points_m[:, 0] * 100 == pytest.approx([44, 44])
    assert driving.drives[:, 0] == pytest.approx([-0.36, -0.66])
    # The hand goes on from where it is, and rests where it did.
    assert end.points_m[:, 0] * 100 == pytest.approx([45 + 3.4, 50])


def grasp_at(points_m):
    """A path that grasps at the second of four points."""
    return stretches(Recorded(points_m, np.array([-1, -1, 1, 1]), np.zeros((4, 2))))


def test_the_follower_reaches_the_point_of_a_grasp_stands_and_goes_on():
    follower, ee_m, holding = Follower(grasp_at(line(0, 3, 6, 3, 0))), np.zeros(3), False
    steps = []
    while not follower.finished and len(steps) < 40:
        action = follower.act(ee_m, holding)
        steps.append((ee_m[0], action))
        ee_m = ee_m + STEP_M * action[:3]
        holding = action[3] > 0
    still = [number for number, (_, action) in enumerate(steps) if not action[:3].any()]
    grasps = [number for number, (_, action) in enumerate(steps) if action[3] > 0]
    assert still[0] == grasps[0]
    assert abs(steps[grasps[0]][0] - 0.06) < 0.01
    assert all(action[0] < 0 for _, action in steps[grasps[0] + 1 : -1])
    assert abs(ee_m[0]) < 0.01
    assert follower.finished


class PointEnv:
    """A hand without inertia that has to hold and be back at the start."""

    action_space = spaces.Box(-1, 1, (4,), np.float32)
    unwrapped = None

    def reset(self, seed, options):
        self.ee_m, self.holding, self.executed = np.zeros(3), False, []
        return self._obs(), {}

    def step(self, action):
        entries = action[0].numpy()
        self.executed.append(entries)
        self.ee_m = self.ee_m + STEP_M * entries[:3]
        self.holding = bool(entries[3] >= 0)
        success = self.holding and abs(self.ee_m[0]) < 0.02
        return self._obs(), 0.0, np.array([success]), np.array([False]), {"success": [success]}

    def _obs(self):
        ee_m = torch.tensor(self.ee_m[None], dtype=torch.float32)
        return {"agent": {"ee_position": ee_m, "is_holding": torch.tensor([[float(self.holding)]])}}


LAYOUT = ObservationLayout(
    state=(("agent", "ee_position"), ("agent", "is_holding")), state_sizes=(3, 1)
)


def test_labels_are_clean_while_executed_actions_are_disturbed():
    env, episode, path = PointEnv(), SimpleNamespace(seed=0), grasp_at(line(0, 10, 20, 10, 0))
    noise = Disturbance(0.5, np.random.default_rng(3))
    failure, examples = replay(env, LAYOUT, episode, path, noise)
    assert failure is None
    executed = np.stack(env.executed)
    assert 0.2 < (executed != examples.actions.numpy()).any(axis=1).mean() < 0.9
    assert np.abs(executed).max() <= 1
    # The labels are those of a follower that saw the same states.
    follower = Follower(path)
    for state, label in zip(examples.state.numpy(), examples.actions.numpy(), strict=True):
        wanted = follower.act(state[:3].astype(float), bool(state[3]))
        assert wanted == pytest.approx([*label, 0, 0], abs=1e-5)
    assert examples.lengths.tolist() == [len(executed)]
    calm = Disturbance(0.0, np.random.default_rng(3))
    failure, examples = replay(env, LAYOUT, episode, path[:1], calm)
    assert failure == "path ended"  # as nothing was grasped


class HandToy:
    """A hand that moves 1.5 cm a step; success within 3 cm of a goal, truncated at LIMIT."""

    def __init__(self, rows):
        self.num_envs = rows
        box = spaces.Box(-np.inf, np.inf, (3,), np.float32)
        holding = spaces.Box(0, 1, (1,), np.float32)
        agent = spaces.Dict({"ee_position": box, "is_holding": holding})
        self.single_observation_space = spaces.Dict({"agent": agent})
        self.single_action_space = spaces.Box(-1, 1, (4,), np.float32)
        self.ee_m, self.goals = np.zeros((rows, 3)), [None] * rows
        self.steps = np.zeros(rows, dtype=int)
        self.played = []

    def reset(self, *, options):
        for row in np.flatnonzero(options.get("reset_mask", np.ones(self.num_envs, bool))):
            self.goals[row] = options["episode"][row]
            self.ee_m[row], self.steps[row] = 0.0, 0
            self.played.append(self.goals[row])
        return self._obs(), {}

    def step(self, actions):
        self.ee_m = self.ee_m + STEP_M * np.clip(actions[:, :3], -1, 1)
        self.steps += 1
        gaps_m = np.linalg.norm(self.ee_m - np.array(self.goals), axis=1)
        success = gaps_m < 0.03
        reward, truncated = np.zeros(self.num_envs), (self.steps >= LIMIT) & ~success
        return self._obs(), reward, success, truncated, {"success": success}

    def _obs(self):
        holding = np.zeros((self.num_envs, 1), np.float32)
        return {"agent": {"ee_position": self.ee_m.astype(np.float32), "is_holding": holding}}


def lesson(goal):
    points_m = spaced(np.array([[0.0, 0.0, 0.0], goal]))
    return Lesson(goal, [Stretch(points_m=points_m, gripper=-1.0)])


def test_each_lesson_is_played_once_and_labelled_by_its_path():
    lessons = [lesson((0.3, 0.0, 0.0)), lesson((0.0, 0.3, 0.0)), lesson((0.3, 0.3, 0.0))]
    env = HandToy(2)
    layout = ObservationLayout.of(env.single_observation_space)
    student = new_policy(layout, env.single_action_space, NetworkConfig(log_std=-9.0), 0)
    with torch.no_grad():  # it always goes along x
        student.actor[-1].weight.zero_()
        student.actor[-1].bias.copy_(torch.tensor([1.0, 0.0, 0.0, -1.0]))
    visits = practise(student, lessons, env, [0])
    assert (visits.episodes, visits.successes) == (3, 1)
    assert set(env.played) == {one.episode for one in lessons}
    by_goal = {tuple(np.round(part.actions[0, :3].tolist(), 1)): part for part in visits.parts}
    assert len(by_goal[1.0, 0.0, 0.0].state) == 19  # 0.27 m are 18 steps; then within 3 cm
    beside = by_goal[0.0, 1.0, 0.0]
    # The hand is off to the right of the path, and the label leads back to it.
    assert (beside.actions[5:40, 0] < 0).all()


def test_examples_are_kept_in_a_file(tmp_path):
    env = find_recipe("close_drawer_blind").env
    episodes = []
    for steps in (3, 2):
        seen = [
            Observation(torch.full((1, 2), float(n)), torch.rand(1, 1, 4, 4)) for n in range(steps)
        ]
        episodes.append(Examples.of(seen, np.zeros((steps, 4), np.float32)))
    examples = Examples.joined(episodes)
    assert examples.images.dtype == torch.float16
    file = tmp_path / "demonstrations.safetensors"
    still = Stretch(points_m=np.arange(6.0).reshape(2, 3), gripper=-1.0, end_m=np.ones(3))
    drive = np.array([[0.5, 0.0]])
    drives = Stretch(points_m=np.ones((1, 3)), gripper=1.0, drives=drive, reached_m=0.2)
    paths = [Followed(7, [still, drives]), Followed(9, [drives])]
    about = {"agent": "", "seed": 0, "counts": {}}
    write_examples(file, examples, paths, env, about)
    found, followed, _ = read_examples(file, env)
    assert [(one.number, len(one.path)) for one in followed] == [(7, 2), (9, 1)]
    for one, other in zip(followed[0].path, (still, drives), strict=True):
        for name in ("points_m", "gripper", "drives", "end_m", "reached_m"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert found.starts().tolist() == [True, False, False, True, False]
    assert torch.equal(found.episodes(torch.tensor([1])).state, examples.state[3:])
    assert torch.equal(found.images, examples.images)
    with pytest.raises(PolicyFileError, match="handle_position True, not False"):
        read_examples(file, replace(env, handle_position=False))
    _check_damaged(file, env)


def _check_damaged(file, env):
    """Damages each part of a file of demonstrations in turn."""
    tensors, about = checkpoint.load(file)

    def check(case):
        edits, *words = case
        named = {name: edits[name] for name in edits.keys() & about.keys()}
        changed = {**tensors, **{name: edits[name] for name in edits.keys() - about.keys()}}
        kept = {name: value for name, value in changed.items() if value is not None}
        checkpoint.save(file, kept, {**about, **named})
        refused_by_call(lambda: read_examples(file, env), str(file), *words)

    cases = {f"no {n}": ({n: None}, f"{n} is missing") for n in tensors if n != "images"}
    cases |= {f"flat {name}": ({name: torch.zeros(())}, name) for name in tensors}
    cases |= {f"few {name}": ({name: tensors[name][1:]}, name) for name in ("actions", "images")}
    floats = ("state", "images", "actions", "path_points", "path_stretches")
    for name, at, values in (
        *((name, 0, (float("nan"),)) for name in floats),
        ("lengths", 0, (-1, 0, 1, 2**62)),
        ("path_stretches", (0, 0), (0, 1, -1)),
        ("path_episodes", (0, 0), (-1, 10**6)),
    ):
        for value in values:
            changed = tensors[name].clone()
            changed[at] = value
            cases[f"{name} {at} {value}"] = ({name: changed}, name)
    cases["drives"] = {"path_drives": tensors["path_drives"][1:]}, "path_drives has 3 rows"
    cases["env"] = {"env": []}, "not a file of demonstrations"
    check_each(cases, check)
    whole = file.read_bytes()
    for size in (0, 5, 100, len(whole) - 1):
        file.write_bytes(whole[:size])
        refused_by_call(lambda: read_examples(file, env), str(file), "not a file")
