"""Every environment in every control mode: spaces, rewards, purity, determinism, bad actions."""

import numpy as np
import pytest
import torch
from builders import same

from hab_tasks.envs import ENVS
from hab_tasks.errors import ActionError, UnknownNameError
from hab_tasks.robots.control import control_configs

ENV_MODES = [(e.id, mode) for e in ENVS.values() for mode in e.env.skill.control_modes]
every_env = pytest.mark.parametrize("env_id", ENVS)
every_mode = pytest.mark.parametrize(("env_id", "mode"), ENV_MODES)


def actions(env, count, seed=0):
    """Random actions; joint targets stay near the present pose, as a planner's do."""
    rng = np.random.default_rng(seed)
    space, base = env.action_space, env.unwrapped
    drawn = rng.uniform(-1, 1, (count, *space.shape)).astype(np.float32)
    if base.control_mode.startswith("joint_target"):
        drawn[:, :7] = arm(base) + 0.1 * drawn[:, :7]
    return np.clip(drawn, space.low, space.high)


def arm(base):
    return base.agent.controller.arm_target_rad[0].numpy()


def play(env, sequence):
    """Steps until the episode ends; returns every (obs, reward, terminated, truncated, info)."""
    steps = []
    for action in sequence:
        steps.append(env.step(action))
        if steps[-1][2] or steps[-1][3]:
            break
    return steps


def flat(value, name=""):
    """Every tensor or array of a nested dict with its path."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from flat(item, f"{name}/{key}")
    else:
        yield name, value


@every_mode
def test_observations_lie_in_their_space(make, env_id, mode):
    env = make(env_id, obs_mode="state_dict", control_mode=mode)
    obs, _ = env.reset(seed=0)
    spaces = env.observation_space
    for o in (obs, *(step[0] for step in play(env, actions(env, 30)))):
        arrays = {name: value.numpy() for name, value in flat(o)}
        for name, array in arrays.items():
            assert np.isfinite(array).all(), name
            assert array.dtype == np.float32, name
        for group in spaces:
            for key, space in spaces[group].items():
                assert space.contains(o[group][key].numpy()), (group, key)
    entries = {e.name: e.shape for e in ENVS[env_id].env.skill.observation}
    shapes = {name.rsplit("/", 1)[-1]: tuple(value.shape[1:]) for name, value in flat(obs)}
    assert shapes == entries


@every_env
def test_flat_state_is_all_entries_in_order(make, env_id):
    flat_env, dict_env = make(env_id, obs_mode="state"), make(env_id, obs_mode="state_dict")
    state, parts = flat_env.reset(seed=3)[0], dict_env.reset(seed=3)[0]
    entries = [e.name for e in ENVS[env_id].env.skill.observation]
    values = {name.rsplit("/", 1)[-1]: value for name, value in flat(parts)}
    assert torch.equal(state, torch.cat([values[name] for name in entries], dim=1))


@every_mode
def test_the_terms_sum_to_the_reward(make, env_id, mode):
    env = make(env_id, control_mode=mode)
    env.reset(seed=1)
    for _, reward, terminated, truncated, info in play(env, actions(env, 40)):
        assert reward.shape == terminated.shape == (1,)
        assert torch.isfinite(reward).all()
        assert torch.allclose(torch.stack(tuple(info["reward_terms"].values())).sum(0), reward)
        assert bool(terminated) == bool(info["success"] | info["fail"])
        assert bool(info["fail"]) == any(bool(f) for f in info["failures"].values())
        assert not (info["success"] & info["fail"])
        assert not truncated or int(info["elapsed_steps"]) == ENVS[env_id].horizon_steps


@every_env
def test_reset_pays_and_ends_nothing(make, env_id):
    env = make(env_id)
    _, info = env.reset(seed=1)
    evaluated = env.unwrapped.evaluate()
    assert not evaluated["success"]
    assert not evaluated["fail"]
    assert not evaluated["reward_terms"]["pickup"]
    assert "reconfigure" in info


@every_env
def test_the_normalised_reward_is_the_reward_over_its_bound(make, env_id):
    runs = {}
    for mode in ("dense", "normalized_dense"):
        env = make(env_id, reward_mode=mode)
        env.reset(seed=1)
        runs[mode] = torch.cat([step[1] for step in play(env, actions(env, 30))])
    bound = ENVS[env_id].env.skill.reward_bound
    assert torch.allclose(runs["normalized_dense"], (runs["dense"] / bound).clamp(max=1.0))
    assert runs["dense"].any()


@every_mode
def test_looking_changes_nothing(make, env_id, mode):
    env = make(env_id, control_mode=mode)
    base = env.unwrapped
    env.reset(seed=2)
    play(env, actions(env, 10))
    before = base.get_state_dict()
    first = base.evaluate(), base.get_obs()
    second = base.evaluate(), base.get_obs()
    base.privileged()
    assert all(same(a, b) for a, b in zip(first, second, strict=True))
    assert same(base.get_state_dict(), before)


@every_mode
def test_two_episodes_are_the_same_with_the_same_actions(make, env_id, mode):
    """Bit for bit where the simulation is new, in an environment that has played before as well.

    In a simulation that has shown other layouts, to a ten thousandth: the engine keeps traces.
    """
    records = []
    worn = make(env_id, control_mode=mode)
    worn.reset(seed=9)
    play(worn, actions(worn, 25, seed=5))
    new = {"reconfigure": True}
    for env, options in ((make(env_id, control_mode=mode), new), (worn, new), (worn, {})):
        record = []
        for seed in (4, 6):
            obs, _ = env.reset(seed=seed, options=dict(options))
            record.append({"obs": obs})
            for obs, reward, *_, info in play(env, actions(env, 60, seed=seed)):
                record.append({"obs": obs, "reward": reward, "measures": info["measures"]})
        records.append(record)
    assert len(records[0]) > 20
    for step, (fresh, rebuilt, shown) in enumerate(zip(*records, strict=True)):
        assert same(fresh, rebuilt), f"step {step} differs"
        assert same(fresh["obs"], shown["obs"], atol=1e-4), f"step {step} differs"


@every_env
def test_seeds_choose_the_episode(make, env_id):
    env = make(env_id)

    def chosen(seed):
        env.reset(seed=seed)
        return env.unwrapped.episode[0].id

    ids = [chosen(seed) for seed in range(12)]
    assert ids == [chosen(seed) for seed in range(12)]
    assert len(set(ids)) > 3


@every_env
def test_an_episode_can_be_asked_for_by_index_or_itself(make, env_id):
    env = make(env_id)
    source = env.unwrapped._world.source
    for wish in (3, source.get(5)):
        env.reset(options={"episode": wish})
        expected = source.get(wish) if isinstance(wish, int) else wish
        assert env.unwrapped.episode == (expected,)


@every_env
def test_the_start_is_the_episodes(make, env_id):
    env = make(env_id)
    env.reset(options={"episode": 2})
    (episode,) = env.unwrapped.episode
    (state,) = env.unwrapped.privileged()
    assert np.allclose(state.arm_qpos, episode.robot.arm_qpos_rad, atol=1e-5)
    assert np.allclose(state.world_from_base[:2, 3], episode.robot.base[:2], atol=1e-5)
    for name, pose in episode.objects.items():
        assert np.allclose(state.world_from_body[name][:3, 3], pose[:3], atol=1e-5)


@every_env
def test_episodes_end_at_the_horizon(make, env_id):
    env = make(env_id, control_mode="ee")
    env.reset(seed=0)
    still = np.array([0, 0, 0, -1], dtype=np.float32)
    horizon = ENVS[env_id].horizon_steps
    truncated = [bool(env.step(still)[3]) for _ in range(horizon)]
    assert truncated == [False] * (horizon - 1) + [True]
    assert horizon == 200


# Actions ---------------------------------------------------------------------------------------


def bad_actions(size):
    good = np.zeros(size, dtype=np.float32)
    for value in (np.nan, np.inf, -np.inf):
        bad = good.copy()
        bad[size // 2] = value
        yield bad
    yield np.zeros(size + 1, dtype=np.float32)
    yield np.zeros(size - 1, dtype=np.float32)
    yield np.zeros((2, size), dtype=np.float32)
    yield np.zeros((1, 1, size), dtype=np.float32)
    yield np.float32(0.0)
    yield "forward"


@every_mode
def test_a_bad_action_is_refused_and_nothing_moves(make, env_id, mode):
    env = make(env_id, control_mode=mode)
    env.reset(seed=0)
    play(env, actions(env, 3))
    before, elapsed = env.unwrapped.get_state_dict(), env.unwrapped.elapsed_steps.clone()
    for bad in bad_actions(env.action_space.shape[0]):
        with pytest.raises(ActionError):
            env.step(bad)
    assert same(env.unwrapped.get_state_dict(), before)
    assert torch.equal(env.unwrapped.elapsed_steps, elapsed)


@every_mode
def test_actions_out_of_range_are_clipped(make, env_id, mode):
    ends = []
    for factor in (1.0, 7.0):
        env = make(env_id, control_mode=mode)
        env.reset(seed=0)
        high = env.action_space.high
        env.step(np.where(np.arange(len(high)) == 0, factor * high, 0.0).astype(np.float32))
        ends.append(env.unwrapped.get_state_dict())
    assert same(*ends)


@every_env
def test_an_ee_action_moves_the_hand_by_one_and_a_half_centimetres(make, env_id):
    env = make(env_id, control_mode="ee")
    env.reset(seed=0)
    kinematics = env.unwrapped.agent.controller._kinematics
    # Forwards, left and down: upwards a shoulder at its limit shortens the way.
    for axis, sign in enumerate((1.0, 1.0, -1.0)):
        action = np.zeros(4, dtype=np.float32)
        action[axis], action[3] = sign, -1.0
        before = kinematics.position(arm(env.unwrapped).astype(float))
        env.step(action)
        moved = kinematics.position(arm(env.unwrapped).astype(float)) - before
        # Damping takes a little off; within a tenth.
        assert np.linalg.norm(moved - 0.015 * action[:3]) < 0.0015


@every_env
def test_a_joint_action_moves_each_joint_by_its_share(make, env_id):
    env = make(env_id, control_mode="joint_delta")
    env.reset(seed=0)
    before = arm(env.unwrapped).copy()
    # Towards zero, away from the joints' limits.
    entries = -np.sign(before) * np.array([1, 1, 0.5, 0, 0.25, 0.5, 1], dtype=np.float32)
    env.step(np.append(entries, -1).astype(np.float32))
    # 0.0125 rad times the entry
    assert np.allclose(arm(env.unwrapped) - before, 0.0125 * entries, atol=1e-6)


@every_env
def test_an_unknown_control_mode_names_the_nearest(make, env_id):
    with pytest.raises(UnknownNameError, match="Did you mean 'joint_delta'"):
        make(env_id, control_mode="joint_dleta")


def test_every_arm_mode_has_a_twin_that_moves_the_base():
    modes = control_configs()
    for name, config in modes.items():
        assert name.endswith("_base") == config.base
        assert modes[name.removesuffix("_base")].arm == config.arm
