"""Interface of the vector environment: seeds, groups, masks, info, calls, and other libraries."""

from contextlib import closing

import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from playing import slow
from vectors import MAX_STEPS, make_vec, sampled_actions

from hab_tasks.errors import ActionError, EpisodeError, HabError, OptionError, UnknownNameError

ROWS = 4


@pytest.fixture(scope="module")
def env():
    """Four rows of Pick in two workers, in two groups."""
    options = {"num_workers": 2, "num_groups": 2, "info_keys": ("success", "measures.force_n")}
    with closing(make_vec("HabPick-v1", ROWS, **options)) as made:
        yield made


def actions_of(env, steps, seed=0):
    return sampled_actions(env.single_action_space, env.num_envs, steps, seed)


def test_it_is_a_vector_env_of_gymnasium(env):
    assert isinstance(env, VectorEnv)
    assert (env.num_envs, env.spec.id) == (ROWS, "HabPick-v1")
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    obs, info = env.reset(seed=1)
    assert env.observation_space.contains(obs)
    assert obs.shape == (ROWS, *env.single_observation_space.shape)
    assert set(info) == {"success", "_success", "measures", "_measures"}
    assert set(info["measures"]) == {"force_n", "_force_n"}
    obs, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    assert env.observation_space.contains(obs)
    assert reward.shape == terminated.shape == truncated.shape == (ROWS,)
    assert (reward.dtype, terminated.dtype, truncated.dtype) == (np.float32, bool, bool)


def test_a_seed_gives_the_same_and_rows_differ(env):
    first, again = env.reset(seed=7)[0], env.reset(seed=7)[0]
    assert np.array_equal(first, again)
    assert np.array_equal(first, env.reset(seed=[7, 8, 9, 10])[0])
    assert len(np.unique(first, axis=0)) == ROWS
    assert not np.array_equal(env.reset(seed=8)[0], first)


def test_the_number_of_workers_changes_nothing(env):
    options = {"num_workers": 1, "num_groups": 4, "info_keys": ()}
    with closing(make_vec("HabPick-v1", ROWS, **options)) as other:
        assert np.array_equal(env.reset(seed=3)[0], other.reset(seed=3)[0])
        for action in actions_of(env, MAX_STEPS + 5):
            ours, theirs = env.step(action)[:4], other.step(action)[:4]
            assert all(np.array_equal(a, b) for a, b in zip(ours, theirs, strict=True))


def test_groups_step_while_the_others_wait(env):
    actions = actions_of(env, 6)
    env.reset(seed=2)
    together = [env.step(action)[:4] for action in actions]
    env.reset(seed=2)
    first, second = env.groups
    assert sorted([*first, *second]) == list(range(ROWS))
    env.async_step(first, actions[0][first])
    for step, action in enumerate(actions):
        env.async_step(second, action[second])
        for rows in (first, second):
            found = env.wait(rows)[:4]
            for part, whole in zip(found, together[step], strict=True):
                assert np.array_equal(part, whole[rows])
            if rows is first and step + 1 < len(actions):
                env.async_step(first, actions[step + 1][first])


def test_groups_are_asked_for_in_order(env):
    env.reset(seed=2)
    first, second = env.groups
    actions = actions_of(env, 1)[0]
    with pytest.raises(OptionError, match="call async_step first"):
        env.wait(first)
    env.async_step(first, actions[first])
    for call, words in (
        (lambda: env.async_step(first, actions[first]), "still being stepped; call wait"),
        (lambda: env.reset(seed=2), "call wait before reset"),
        (lambda: env.wait(np.array([0, 3, 1])), r"one of the 2 arrays in env\.groups"),
    ):
        with pytest.raises(OptionError, match=words):
            call()
    env.wait(first)
    env.async_step(second, actions[second])
    env.wait(second)


def test_a_mask_resets_some_rows(env):
    before, _ = env.reset(seed=4)
    for action in actions_of(env, 3):
        before = env.step(action)[0]
    mask = np.array([False, True, False, True])
    after, _ = env.reset(seed=4, options={"reset_mask": mask})
    assert np.array_equal(after[~mask], before[~mask])
    assert np.array_equal(after[mask], env.reset(seed=4)[0][mask])


def test_episodes_are_chosen_for_all_rows_or_each(env):
    alike, _ = env.reset(seed=0, options={"episode": 3})
    assert len(np.unique(alike, axis=0)) == 1
    each, _ = env.reset(seed=0, options={"episode": [3, 1, 2, 3]})
    assert np.array_equal(each[[0, 3]], alike[[0, 3]])
    names = [episode.id for (episode,) in env.get_attr("episode")]
    assert [name.rsplit("/", 1)[-1] for name in names] == ["00003", "00001", "00002", "00003"]


def test_bad_actions_and_resets_are_refused_and_the_next_works(env):
    nan = [[0.0] * 4] * 3 + [[0.0, np.nan, 0.0, 0.0]]
    for action, words in (
        (np.zeros((ROWS, 3)), r"shape \(4, 3\); expected \(4, 4\)"),
        (nan, "Action 3 has a non-finite value"),
        ([["a"] * 4] * 4, "not an array of numbers"),
    ):
        with pytest.raises(ActionError, match=words):
            env.step(action)
    for arguments, error, words in (
        ({"seed": -1}, OptionError, "seed is -1"),
        ({"options": {"reset_mask": [True]}}, OptionError, "an array of 4 booleans"),
        ({"options": {"reset_mask": np.zeros(ROWS, bool)}}, OptionError, "one of them True"),
        ({"options": {"episode": 50}}, EpisodeError, "Episode 50: valid indices are 0 to 7"),
        ({"options": {"episode": [1, 2]}}, OptionError, "one, or 4 in a list"),
    ):
        with pytest.raises(error, match=words):
            env.reset(**arguments)
        assert env.reset(seed=1)[0].shape[0] == ROWS
    assert env.step(np.zeros((ROWS, 4)))[0].shape[0] == ROWS


def test_bad_options_are_refused():
    """The last two by the workers."""
    for options, error, words in (
        ({"num_envs": 0}, OptionError, "num_envs is 0.*from 1 to 4,096"),
        ({"num_workers": 3}, OptionError, "num_workers is 3.*at most one for each row"),
        ({"num_groups": 3}, OptionError, "num_groups is 3.*from 1 to 1"),
        ({"autoreset_mode": "sometimes"}, UnknownNameError, "autoreset_mode 'sometimes'"),
        ({"sim_backend": "physx_cuda"}, OptionError, "physx_cpu"),
        ({"action_repeat": 0}, OptionError, "action_repeat is 0.*from 1 to 1,000"),
        ({"info_keys": 3}, OptionError, "info_keys is 3"),
        ({"info_keys": ["success_"]}, UnknownNameError, "'success_'. Did you mean 'success'"),
        ({"scene_dataset": "/nowhere"}, HabError, "/nowhere"),
    ):
        with pytest.raises(error, match=words):
            make_vec("HabPick-v1", **{"num_envs": 2, "num_workers": 2, **options})


def test_it_is_used_in_order():
    options = {"autoreset_mode": AutoresetMode.DISABLED, "copy": False}
    with closing(make_vec("HabPick-v1", 1, **options)) as env:
        with pytest.raises(ResetNeeded, match="Call reset before step"):
            env.step(np.zeros((1, 4)))
        env.reset()  # without a seed one is drawn
        still = np.array([[0.0, 0.0, 0.0, -1.0]])
        held = env.step(still)[0]
        assert np.shares_memory(held, env.step(still)[0])  # copy=False
        for _ in range(MAX_STEPS - 2):
            ended = env.step(still)[3]
        assert ended.all()
        with pytest.raises(ResetNeeded, match=r"episodes of rows \[0\] have ended"):
            env.step(still)
        env.reset(options={"reset_mask": ended})
        env.step(still)
    with pytest.raises(ClosedEnvironmentError, match="make a new one"):
        env.reset()


@slow
@pytest.mark.render
def test_rows_are_rendered():
    options = {"num_workers": 1, "render_mode": "rgb_array"}
    with closing(make_vec("HabPick-v1", 2, **options)) as env:
        env.reset(seed=0)
        env.step(actions_of(env, 1)[0])
        frames = env.render()
    assert [frame.shape for frame in frames] == [(512, 512, 3)] * 2
    assert not np.array_equal(*frames)
    assert all(frame.std() > 10 for frame in frames)


@slow
def test_stable_baselines_trains_on_it():
    sb3 = pytest.importorskip("stable_baselines3")
    from hab_tasks.vector.sb3 import SB3VecEnv

    with pytest.raises(OptionError, match="'SameStep' here"):
        SB3VecEnv(make_vec("HabPick-v1", 1))
    options = {"num_workers": 2, "autoreset_mode": AutoresetMode.SAME_STEP}
    with closing(SB3VecEnv(make_vec("HabPick-v1", 4, **options))) as env:
        env.seed(3)
        policy = sb3.PPO("MlpPolicy", env, n_steps=60, batch_size=60, seed=0, device="cpu")
        before = [p.detach().clone() for p in policy.policy.parameters()]
        policy.learn(480)
        after = list(policy.policy.parameters())
        assert any(not a.equal(b) for a, b in zip(after, before, strict=True))
        # Episodes of 25 steps ended, and were recorded whole.
        assert {episode["l"] for episode in policy.ep_info_buffer or ()} <= set(range(26))
        obs = env.reset()
        for _ in range(MAX_STEPS):
            obs, _, done, infos = env.step(np.tile([0.0, 0.0, 0.0, -1.0], (4, 1)))
        assert done.all()
        assert all(info["TimeLimit.truncated"] for info in infos)
        assert all(info["terminal_observation"].shape == obs.shape[1:] for info in infos)
        assert env.env_method("instruct", env.get_attr("episode")[0][0])[0].startswith("Pick up")


@slow
def test_torchrl_rolls_it_out():
    envs = pytest.importorskip("torchrl.envs")
    options = {"obs_mode": "state_dict", "autoreset_mode": AutoresetMode.DISABLED}
    with closing(make_vec("HabPick-v1", 3, num_workers=1, **options)) as env:
        found = envs.GymWrapper(env).rollout(2 * MAX_STEPS, break_when_any_done=False)
        assert found.batch_size == (3, 2 * MAX_STEPS)
        done = found["next", "truncated"][..., 0]
        assert done[:, MAX_STEPS - 1].all()
        assert found["next", "agent", "arm_qpos"].isfinite().all()
