"""Interface of the vector environment: seeds, groups, masks, info, calls, and other libraries."""

import gymnasium as gym
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
    made = make_vec(
        "HabPick-v1",
        ROWS,
        num_workers=2,
        num_groups=2,
        info_keys=("success", "measures.force_n"),
    )
    yield made
    made.close()


def actions_of(env, steps, seed=0):
    return sampled_actions(env.single_action_space, env.num_envs, steps, seed)


def test_it_is_a_vector_env_of_gymnasium(env):
    assert isinstance(env, VectorEnv)
    assert env.num_envs == ROWS
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert env.spec.id == "HabPick-v1"
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
    listed = env.reset(seed=[7, 8, 9, 10])[0]
    assert np.array_equal(first, again)
    assert np.array_equal(first, listed)
    assert len(np.unique(first, axis=0)) == ROWS
    assert not np.array_equal(env.reset(seed=8)[0], first)


def test_the_number_of_workers_changes_nothing(env):
    other = make_vec("HabPick-v1", ROWS, num_workers=1, num_groups=4, info_keys=())
    try:
        assert np.array_equal(env.reset(seed=3)[0], other.reset(seed=3)[0])
        for action in actions_of(env, MAX_STEPS + 5):
            ours, theirs = env.step(action)[:4], other.step(action)[:4]
            assert all(np.array_equal(a, b) for a, b in zip(ours, theirs, strict=True))
    finally:
        other.close()


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
    with pytest.raises(OptionError, match="still being stepped; call wait"):
        env.async_step(first, actions[first])
    with pytest.raises(OptionError, match="call wait before reset"):
        env.reset(seed=2)
    with pytest.raises(OptionError, match=r"rows is .*one of the 2 arrays in env\.groups"):
        env.wait(np.array([0, 3, 1]))
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
    assert np.array_equal(each[0], alike[0])
    assert np.array_equal(each[3], alike[0])
    assert not np.array_equal(each[1], each[2])
    names = [episode.id for (episode,) in env.get_attr("episode")]
    assert [name.rsplit("/", 1)[-1] for name in names] == ["00003", "00001", "00002", "00003"]


def test_a_row_can_be_asked_for_its_state(env):
    env.reset(seed=6)
    for action in actions_of(env, 4):
        obs, reward, *_ = env.step(action)
    states = env.call("get_state_dict")
    assert [float(state["hab"]["tracker"]["steps"][0, 0]) for state in states] == [4.0] * ROWS
    row = 1
    single = gym.make("hab_tasks:HabPick-v1", num_episodes=8)
    single.reset(seed=6 + row)
    single.unwrapped.set_state_dict(states[row])
    info = single.unwrapped.get_info()
    # The engine computes the links' poses from the joints; in a step, it integrates them too.
    np.testing.assert_allclose(single.unwrapped.get_obs(info)[0], obs[row], atol=1e-6)
    assert float(info["reward"][0]) == pytest.approx(float(reward[row]), abs=1e-6)
    single.close()


def test_bad_actions_are_refused(env):
    before, _ = env.reset(seed=1)
    for action, words in (
        (np.zeros((ROWS, 3)), r"shape \(4, 3\); expected \(4, 4\)"),
        (np.zeros(4), r"expected \(4, 4\)"),
        ([[0.0] * 4] * 3 + [[0.0, np.nan, 0.0, 0.0]], "Action 3 has a non-finite value"),
        ([["a"] * 4] * 4, "not an array of numbers"),
        (None, "not an array of numbers|expected"),
    ):
        with pytest.raises(ActionError, match=words):
            env.step(action)
    assert env.step(np.zeros((ROWS, 4)))[0].shape == before.shape


def test_bad_resets_are_refused_and_the_next_works(env):
    nobody = np.zeros(ROWS, dtype=bool)
    for arguments, error, words in (
        ({"seed": -1}, OptionError, "seed is -1"),
        ({"seed": [1, 2]}, OptionError, "one, or 4 in a list"),
        ({"options": {"reset_mask": [True]}}, OptionError, "an array of 4 booleans"),
        ({"options": {"reset_mask": nobody}}, OptionError, "one of them True"),
        ({"options": {"episode": 50}}, EpisodeError, "Episode 50: valid indices are 0 to 7"),
        ({"options": {"episode": [1, 2]}}, OptionError, "one, or 4 in a list"),
        ({"options": 3}, OptionError, "a dict, or None"),
    ):
        with pytest.raises(error, match=words):
            env.reset(**arguments)
        assert env.reset(seed=1)[0].shape[0] == ROWS


def test_bad_options_are_refused_before_anything_starts():
    for options, error, words in (
        ({"num_envs": 0}, OptionError, "num_envs is 0.*from 1 to 4,096"),
        ({"num_workers": 3}, OptionError, "num_workers is 3.*at most one for each row"),
        ({"num_workers": 0}, OptionError, "num_workers is 0"),
        ({"num_groups": 3}, OptionError, "num_groups is 3.*from 1 to 1"),
        ({"autoreset_mode": "sometimes"}, UnknownNameError, "autoreset_mode 'sometimes'"),
        ({"sim_backend": "physx_cuda"}, OptionError, r"use gymnasium\.make\(\.\.\., num_envs=N\)"),
        ({"action_repeat": 0}, OptionError, "action_repeat is 0.*from 1 to 1,000"),
        ({"copy": 1}, OptionError, "copy is 1; it has to be True or False"),
        ({"info_keys": 3}, OptionError, "info_keys is 3"),
    ):
        with pytest.raises(error, match=words):
            make_vec("HabPick-v1", **{"num_envs": 2, "num_workers": 2, **options})


def test_workers_report_bad_options():
    for options, error, words in (
        ({"info_keys": ["success_"]}, UnknownNameError, "'success_'. Did you mean 'success'"),
        ({"scene_dataset": "/nowhere"}, HabError, "/nowhere"),
    ):
        with pytest.raises(error, match=words):
            make_vec("HabPick-v1", 1, **options)


def test_it_is_used_in_order():
    env = make_vec("HabPick-v1", 1, autoreset_mode=AutoresetMode.DISABLED, copy=False)
    try:
        with pytest.raises(ResetNeeded, match="Call reset before step"):
            env.step(np.zeros((1, 4)))
        env.reset()  # without a seed one is drawn
        still = np.array([[0.0, 0.0, 0.0, -1.0]])
        held = env.step(still)[0]
        assert env.step(still)[0] is not None
        assert np.shares_memory(held, env.step(still)[0])  # copy=False
        for _ in range(MAX_STEPS - 3):
            ended = env.step(still)[3]
        assert ended.all()
        with pytest.raises(ResetNeeded, match=r"episodes of rows \[0\] have ended"):
            env.step(still)
        env.reset(options={"reset_mask": ended})
        env.step(still)
    finally:
        env.close()
    env.close()
    with pytest.raises(ClosedEnvironmentError, match="make a new one"):
        env.reset()


def test_every_row_draws_its_own_episodes():
    """Without a seed too: ten rows of eight episodes are not all the same."""
    env = make_vec("HabPick-v1", 3, num_workers=1, info_keys=())
    try:
        env.reset()
        ids = [episode.id for (episode,) in env.get_attr("episode")]
        obs, _ = env.reset()
        assert len({*ids, *(e.id for (e,) in env.get_attr("episode"))}) > 1
        assert len(np.unique(obs, axis=0)) > 1
    finally:
        env.close()


@slow
@pytest.mark.render
def test_rows_are_rendered():
    env = make_vec("HabPick-v1", 2, num_workers=1, render_mode="rgb_array")
    try:
        env.reset(seed=0)
        env.step(actions_of(env, 1)[0])
        frames = env.render()
        assert [frame.shape for frame in frames] == [(512, 512, 3)] * 2
        assert not np.array_equal(*frames)
        assert all(frame.std() > 10 for frame in frames)
    finally:
        env.close()


# Other libraries -------------------------------------------------------------------------------


@slow
def test_stable_baselines_trains_on_it():
    sb3 = pytest.importorskip("stable_baselines3")
    from hab_tasks.vector.sb3 import SB3VecEnv

    with pytest.raises(OptionError, match="'SameStep' here"):
        SB3VecEnv(make_vec("HabPick-v1", 1))
    env = SB3VecEnv(
        make_vec("HabPick-v1", 4, num_workers=2, autoreset_mode=AutoresetMode.SAME_STEP)
    )
    try:
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
        assert env.env_is_wrapped(object) == [False] * 4
    finally:
        env.close()


@slow
def test_torchrl_rolls_it_out():
    envs = pytest.importorskip("torchrl.envs")
    env = make_vec(
        "HabPick-v1",
        3,
        num_workers=1,
        obs_mode="state_dict",
        autoreset_mode=AutoresetMode.DISABLED,
    )
    try:
        found = envs.GymWrapper(env).rollout(2 * MAX_STEPS, break_when_any_done=False)
        assert found.batch_size == (3, 2 * MAX_STEPS)
        done = found["next", "truncated"][..., 0]
        assert done[:, MAX_STEPS - 1].all()
        assert found["next", "agent", "arm_qpos"].isfinite().all()
    finally:
        env.close()


@slow
def test_episode_statistics_of_gymnasium():
    env = gym.wrappers.vector.RecordEpisodeStatistics(make_vec("HabPick-v1", 2, num_workers=1))
    try:
        env.reset(seed=0)
        lengths = []
        for action in actions_of(env, 2 * MAX_STEPS + 4):
            _, _, terminated, truncated, info = env.step(action)
            if "episode" in info:
                lengths += info["episode"]["l"][info["_episode"]].tolist()
            assert ("episode" in info) == bool((terminated | truncated).any())
        assert len(lengths) >= 4
        assert max(lengths) == MAX_STEPS
    finally:
        env.close()
