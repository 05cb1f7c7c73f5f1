"""Retiming and replay of paths against hand-worked points, and the commands that use them."""

from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from gymnasium import spaces
from hab_ppo import demonstrations, teachers
from hab_ppo.cli import main
from hab_ppo.demonstration_file import Followed, read_examples, write_examples
from hab_ppo.demonstrations import Attempt, DemonstrationPlan, demonstrate
from hab_ppo.errors import PolicyFileError
from hab_ppo.examples import Examples
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.recipes import find_recipe
from hab_ppo.replay import Disturbance, replay
from hab_ppo.retiming import (
    GRASP_STEPS,
    NEAREST_M,
    Follower,
    Recorded,
    Stretch,
    motion,
    spaced,
    straight,
    stretches,
    varied,
    within_workspace,
)

STEP_M = 0.015


def line(*xs):
    """Points on the x axis, in centimetres."""
    return np.array([[x / 100, 0.0, 0.0] for x in xs])


def test_points_are_spaced_along_the_line():
    # 3.5 cm in pieces of at most 1 cm are four of 0.875 cm; standing still adds nothing.
    found = spaced(line(0, 2, 2, 2, 3.5))
    assert found[:, 0] * 100 == pytest.approx([0.875, 1.75, 2.625, 3.5])
    # A corner: 1 cm along x, then 1 cm along y.
    corner = spaced(np.array([[0, 0, 0], [0.01, 0, 0], [0.01, 0.01, 0]]))
    assert corner.round(9).tolist() == [[0.01, 0, 0], [0.01, 0.01, 0]]


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
    rest = Stretch(points_m=line(45, 50), gripper=-1.0)
    free = Stretch(points_m=line(60, 30), gripper=-1.0)
    standing, driving, end = within_workspace([free, pull, rest])[1:]
    assert pytest.approx(0.44) == NEAREST_M
    assert standing.points_m[:, 0] * 100 == pytest.approx([49, 48, 47, 46, 45])
    assert standing.drives is None
    # The 4.4 cm from 45 to 40.6 in pieces of at most 2.2 cm: 42.8 and 40.6. The hand stays at 44,
    # so the base is 1.2 cm and then 3.4 cm back: 1.2 and 2.2 of the 3.33 cm that it drives in a
    # step.
    assert driving.points_m[:, 0] * 100 == pytest.approx([44, 44])
    assert driving.drives[:, 0] == pytest.approx([-0.36, -0.66])
    # The hand goes on from where it is, and rests where it did.
    assert end.points_m[:, 0] * 100 == pytest.approx([45 + 3.4, 50])
    # A hand that comes no nearer, or is empty, changes nothing.
    same = within_workspace([free, replace(pull, points_m=line(49, 45)), rest])
    assert [one.points_m.tolist() for one in same] == [
        free.points_m.tolist(),
        line(49, 45).tolist(),
        rest.points_m.tolist(),
    ]


def test_motion_is_at_most_a_step_along_each_axis():
    assert motion(np.array([0.03, -0.015, 0]), last=False) == pytest.approx([1, -0.5, 0])
    assert motion(np.array([0.003, 0, 0.0015]), last=False) == pytest.approx([1, 0, 0.5])
    # Before the end of a stretch, half of the distance: 0.75 of 1.5 cm.
    assert motion(np.array([0.015, 0, 0]), last=True) == pytest.approx([0.5, 0, 0])
    assert motion(np.array([0.06, 0.03, 0]), last=True) == pytest.approx([1, 0.5, 0])


def test_the_follower_reaches_the_point_of_a_grasp_stands_and_goes_on():
    path = stretches(Recorded(line(0, 3, 6, 3, 0), np.array([-1, -1, 1, 1]), np.zeros((4, 2))))
    follower, ee_m, holding = Follower(path), np.zeros(3), False
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


def test_a_point_that_cannot_be_reached_is_passed():
    follower = Follower([Stretch(points_m=line(1, 2, 3), gripper=-1.0)])
    for _ in range(60):
        follower.act(np.array([0.0, 0.1, 0.0]), False)
    assert follower.finished


def test_a_hand_that_does_not_grasp_goes_on_after_a_while():
    path = [Stretch(points_m=line(0), gripper=-1.0), Stretch(points_m=line(5), gripper=1.0)]
    follower = Follower(path)
    moved = [follower.act(np.zeros(3), False)[:3].any() for _ in range(GRASP_STEPS + 2)]
    assert not any(moved[:GRASP_STEPS])
    assert moved[-1]


def test_straight_paths_keep_what_holds_and_grasp_sooner():
    points = line(0, 10, 20, 10, 0)
    points[1, 1] = points[3, 1] = 0.3  # detours to and from the grasp
    path = stretches(Recorded(points, np.array([-1, -1, 1, 1]), np.zeros((4, 2))))
    changed = straight(path)
    assert path[0].points_m[:, 1].max() > 0.25
    assert changed[0].points_m[:, 1].max() < 0.02
    assert changed[0].points_m[-1].tolist() == path[0].points_m[-1].tolist()
    assert changed[0].reached_m > path[0].reached_m
    assert changed[1] is path[1]


def test_varied_paths_shift_the_way_to_a_grasp_and_nothing_that_holds():
    path = stretches(Recorded(line(0, 30, 60, 30, 0), np.array([-1, -1, 1, 1]), np.zeros((4, 2))))
    changed = varied(path, np.random.default_rng(0))
    assert changed[1] is path[1]
    assert np.array_equal(changed[0].points_m[0], path[0].points_m[0])
    assert changed[0].points_m[-1, 0] < path[0].points_m[-1, 0]
    assert np.array_equal(changed[0].goal_m, path[0].points_m[-1])
    assert changed[0].reached_m > path[0].reached_m


class PointEnv:
    """A hand without inertia that has to hold and be back at the start."""

    action_space = spaces.Box(-1, 1, (4,), np.float32)

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
        return {
            "agent": {
                "ee_position": torch.tensor(self.ee_m[None], dtype=torch.float32),
                "is_holding": torch.tensor([[float(self.holding)]]),
            }
        }


LAYOUT = ObservationLayout(
    state=(("agent", "ee_position"), ("agent", "is_holding")), state_sizes=(3, 1)
)
PATH = stretches(Recorded(line(0, 10, 20, 10, 0), np.array([-1, -1, 1, 1]), np.zeros((4, 2))))


def test_labels_are_clean_while_executed_actions_are_disturbed():
    env, episode = PointEnv(), SimpleNamespace(seed=0)
    noise = Disturbance(0.5, np.random.default_rng(3))
    failure, examples = replay(env, LAYOUT, episode, PATH, noise)
    assert failure is None
    executed = np.stack(env.executed)
    assert 0.2 < (executed != examples.actions.numpy()).any(axis=1).mean() < 0.9
    assert np.abs(executed).max() <= 1
    # The labels are those of a follower that saw the same states.
    follower = Follower(PATH)
    for state, label in zip(examples.state.numpy(), examples.actions.numpy(), strict=True):
        assert follower.act(state[:3].astype(float), bool(state[3])) == pytest.approx(
            [*label, 0, 0], abs=1e-5
        )
    assert examples.lengths.tolist() == [len(executed)]


def test_without_noise_what_is_executed_is_the_label():
    env, calm = PointEnv(), Disturbance(0.0, np.random.default_rng(3))
    _, examples = replay(env, LAYOUT, SimpleNamespace(seed=0), PATH, calm)
    assert np.array_equal(np.stack(env.executed), examples.actions.numpy())


def test_a_replay_that_ends_without_success_says_so():
    path = [Stretch(points_m=line(1, 2), gripper=-1.0)]
    calm = Disturbance(0, np.random.default_rng(0))
    failure, _ = replay(PointEnv(), LAYOUT, SimpleNamespace(seed=0), path, calm)
    assert failure == "path ended"


# Files and commands -----------------------------------------------------------------------------


def example(steps, images=None):
    shown = None if images is None else torch.full((1, 1, 4, 4), images)
    seen = [Observation(torch.full((1, 2), float(step)), shown) for step in range(steps)]
    return Examples.of(seen, np.zeros((steps, 4), np.float32))


def test_examples_are_kept_in_a_file(tmp_path):
    env = find_recipe("close_drawer_blind").env
    examples = Examples.joined([example(3, images=0.25), example(2, images=0.5)])
    assert examples.images.dtype == torch.float16
    file = tmp_path / "demonstrations.safetensors"
    still = Stretch(points_m=np.arange(6.0).reshape(2, 3), gripper=-1.0, end_m=np.ones(3))
    drives = Stretch(
        points_m=np.ones((1, 3)), gripper=1.0, drives=np.array([[0.5, 0.0]]), reached_m=0.2
    )
    paths = [Followed(7, [still, drives]), Followed(9, [drives])]
    write_examples(file, examples, paths, env, {"agent": "a:b"})
    found, followed, about = read_examples(file, env)
    assert [(one.number, len(one.path)) for one in followed] == [(7, 2), (9, 1)]
    for one, other in zip(followed[0].path, paths[0].path, strict=True):
        for name in ("points_m", "gripper", "drives", "end_m", "reached_m"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert about["agent"] == "a:b"
    assert found.starts().tolist() == [True, False, False, True, False]
    assert torch.equal(found.episodes(torch.tensor([1])).state, examples.state[3:])
    assert torch.equal(found.images, examples.images)
    with pytest.raises(PolicyFileError, match="demonstrations of HabCloseDrawer-v1, not HabPick"):
        read_examples(file, find_recipe("pick_blind").env)
    with pytest.raises(PolicyFileError, match="handle_position True, not False"):
        read_examples(file, replace(env, handle_position=False))
    with pytest.raises(PolicyFileError, match="episode_seed 0, not 1"):
        read_examples(file, replace(env, episode_seed=1))


@pytest.fixture
def attempts(monkeypatch):
    """Replaces the simulators by a list of attempts."""
    given = []

    @contextmanager
    def fake(plan, most):
        yield iter(given[:most])

    monkeypatch.setattr(demonstrations, "load_agent", lambda *_: None)
    monkeypatch.setattr(demonstrations, "training_episodes", lambda *_: ())
    monkeypatch.setattr(demonstrations, "_attempts", fake)
    return given


ARRAYS = (np.zeros((3, 2), np.float32), None, np.zeros((3, 4), np.float32))
GOOD = Attempt(None, None, ARRAYS, Followed(0, []))


def test_demonstrations_are_counted_by_failure(attempts):
    attempts += [Attempt("timeout"), GOOD, Attempt(None, "force"), GOOD, GOOD]
    plan = DemonstrationPlan(recipe=find_recipe("pick_blind"), agent="a:b", count=2)
    lines = []
    made = demonstrate(plan, lines.append)
    assert made.summary() == (
        "the agent solved 3 of 4 episodes (1 timeout), 2 of 3 replays succeeded (1 force)"
    )
    assert made.counts()["demonstrations"] == len(made.parts) == len(lines) == 2


def test_an_agent_that_solves_nothing_is_given_up_in_one_line(attempts, tmp_path, capsys):
    attempts += [Attempt("timeout")] * 100
    out = tmp_path / "demonstrations.safetensors"
    assert main(["demonstrate", "pick_blind", "--out", str(out)]) == 1
    told = capsys.readouterr().err
    assert "no demonstrations of hab_spa:spa_priv" in told
    assert "solved 0 of 25 episodes" in told
    assert told.count("\n") == 1
    assert not out.exists()


def test_bad_input_is_reported_in_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(teachers, "WEIGHTS", tmp_path / "nothing_ships")
    demo, wrong = tmp_path / "demo.safetensors", []
    write_examples(demo, example(3), [], find_recipe("close_drawer_blind").env, {})
    names = {"DEMO": str(demo), "DIR": str(tmp_path / "run"), "FILE": str(tmp_path / "new")}
    for arguments, message in (
        (["demonstrate", "pick_blind", "--out", "FILE", "--agent", "hab_eval:no"], "Unknown agent"),
        (["demonstrate", "pick_blind", "--out", "FILE", "--agent", "no_such:x"], "no_such"),
        (["demonstrate", "pick_blind", "--out", "FILE", "--noise", "2"], "--noise"),
        (["demonstrate", "navigate_blind", "--out", "FILE"], "ee and ee_base"),
        (["demonstrate", "pick_blind", "--out", "DEMO"], "--force"),
        (["train", "pick_blind", "--out", "DIR", "--demonstrations", "DEMO"], "does not start"),
        (["train", "pick_blind", "--out", "DIR", "--teacher", "DEMO"], "has no teacher"),
        (["train", "pick_cloned", "--out", "DIR", "--demonstrations", "DEMO"], "not HabPick-v1"),
        (["train", "place_depth", "--out", "DIR", "--teacher", "nowhere"], "no weights nowhere"),
        (["train", "place_depth", "--out", "DIR", "--teacher", "DEMO"], "no recipe"),
        (["train", "pick_blind", "--out", "DIR", "--weights", "nowhere"], "no weights nowhere"),
        (["train", "pick_blind", "--out", "DIR", "--weights", "DEMO", "--scratch"], "--scratch"),
    ):
        code = main([names.get(word, word) for word in arguments])
        told = capsys.readouterr().err
        if code != 2 or message not in told or told.count("\n") != 1:
            wrong.append((arguments, told))
    assert not wrong
