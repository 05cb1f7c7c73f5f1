"""All environments in all control modes: spaces, rewards, purity, determinism, invalid actions."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from builders import same
from gymnasium import spaces
from playing import (
    actions,
    arm,
    each_family,
    every_env,
    every_mode,
    every_mode_costly,
    flat,
    long,
    play,
    slow,
    still,
)

from hab_tasks.envs import ENVS
from hab_tasks.errors import ActionError, UnknownNameError
from hab_tasks.robots.control import control_configs
from hab_tasks.robots.control_modes import ARM_SIZE, BASE_CELLS, STOP_CELL

HORIZONS = {
    "HabNavigate-v1": 500,
    "HabTidyHouse-v1": 5000,
    "HabPrepareGroceries-v1": 4000,
    "HabSetTable-v1": 4500,
}
"""Of the others it is 200 (S H.2, G.2)."""


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
    entries = {e.name: e.shape for e in ENVS[env_id].env.observation}
    shapes = {name.rsplit("/", 1)[-1]: tuple(value.shape[1:]) for name, value in flat(obs)}
    assert shapes == entries


@each_family
def test_flat_state_is_all_entries_in_order(make, env_id):
    flat_env, dict_env = make(env_id, obs_mode="state"), make(env_id, obs_mode="state_dict")
    state, parts = flat_env.reset(seed=3)[0], dict_env.reset(seed=3)[0]
    entries = [e.name for e in ENVS[env_id].env.observation]
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
    for index in range(4):
        _, info = env.reset(options={"episode": index})
        evaluated = env.unwrapped.evaluate()
        assert not evaluated["success"]
        assert not evaluated["fail"]
        paid = {name: float(term) for name, term in evaluated["reward_terms"].items()}
        assert not any(paid.values()), paid
    assert "reconfigure" in info


@each_family
def test_the_normalised_reward_is_the_reward_over_its_bound(make, env_id):
    runs = {}
    for mode in ("dense", "normalized_dense"):
        env = make(env_id, reward_mode=mode)
        env.reset(seed=1)
        runs[mode] = torch.cat([step[1] for step in play(env, actions(env, 30))])
    assert runs["normalized_dense"].max() <= 1.0
    bound = ENVS[env_id].env.reward_bound
    assert torch.allclose(runs["normalized_dense"], (runs["dense"] / bound).clamp(max=1.0))
    assert runs["dense"].any()


@each_family
def test_the_other_rewards_tell_the_ends_or_nothing(make, env_id):
    for mode in ("sparse", "none"):
        env = make(env_id, reward_mode=mode)
        env.reset(seed=1)
        for _, reward, *_, info in play(env, actions(env, 10)):
            ends = info["success"].float() - info["fail"].float()
            assert torch.equal(reward.float(), ends if mode == "sparse" else torch.zeros(1))


@every_mode_costly
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


def two_episodes(env, count, options):
    """What two episodes of up to `count` random actions show, step for step."""
    found = []
    for seed in (4, 6):
        obs, _ = env.reset(seed=seed, options=dict(options))
        found.append({"obs": obs})
        for obs, reward, *_, info in play(env, actions(env, count, seed=seed)):
            found.append({"obs": obs, "reward": reward, "measures": info["measures"]})
    return found


@every_mode_costly
def test_two_episodes_are_the_same_with_the_same_actions(make, env_id, mode):
    """Bit for bit where the simulation is new, in an environment that has played before as well.

    In a simulation that has shown other layouts, to a ten thousandth: the engine keeps traces.
    """
    worn = make(env_id, control_mode=mode)
    worn.reset(seed=9)
    play(worn, actions(worn, 25, seed=5))
    new = {"reconfigure": True}
    runs = ((make(env_id, control_mode=mode), new), (worn, new), (worn, {}))
    records = [two_episodes(env, 60, options) for env, options in runs]
    assert len(records[0]) > 20
    for step, (fresh, rebuilt, shown) in enumerate(zip(*records, strict=True)):
        assert same(fresh, rebuilt), f"step {step} differs"
        assert same(fresh["obs"], shown["obs"], atol=1e-4), f"step {step} differs"


@pytest.mark.parametrize(
    "env_id", [pytest.param(e, marks=long if HORIZONS.get(e, 0) > 500 else slow) for e in ENVS]
)
def test_two_full_episodes_are_the_same(make, env_id):
    horizon, new = ENVS[env_id].horizon_steps, {"reconfigure": True}
    runs = [two_episodes(make(env_id), horizon, new) for _ in range(2)]
    assert len(runs[0]) == len(runs[1]) > horizon // 4
    for step, (first, second) in enumerate(zip(*runs, strict=True)):
        assert same(first, second), f"step {step} differs"


@pytest.mark.parametrize("steps", [pytest.param(600, marks=slow), pytest.param(10_000, marks=long)])
@every_env
def test_random_steps_stay_finite(make, env_id, steps):
    env, ends = make(env_id), 0
    env.reset(seed=0)
    env.action_space.seed(0)
    for step in range(steps):
        obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert torch.isfinite(obs).all(), f"step {step}"
        assert torch.isfinite(reward).all(), f"step {step}"
        assert all(torch.isfinite(m).all() for m in info["measures"].values()), f"step {step}"
        if terminated or truncated:
            obs, _ = env.reset()
            assert torch.isfinite(obs).all(), f"reset after step {step}"
            ends += 1
    assert ends >= steps // ENVS[env_id].horizon_steps


@each_family
def test_seeds_choose_the_episode(make, env_id):
    env = make(env_id)

    def chosen(seed):
        env.reset(seed=seed)
        return env.unwrapped.episode[0].id

    ids = [chosen(seed) for seed in range(12)]
    assert ids == [chosen(seed) for seed in range(12)]
    assert len(set(ids)) > 3


def test_a_seed_chooses_the_later_episodes_too(make):
    def order(env, seed):
        env.reset(seed=seed)
        ids = []
        for _ in range(8):
            env.reset()
            ids.append(env.unwrapped.episode[0].id)
        return ids

    first, second = make(), make()
    first.reset()
    assert order(first, 3) == order(second, np.int64(3)) == order(first, 3) != order(first, 4)


@each_family
def test_an_episode_can_be_asked_for_by_index_or_itself(make, env_id):
    env = make(env_id)
    source = env.unwrapped._simulation.source
    for wish in (3, source.get(5)):
        env.reset(options={"episode": wish})
        expected = source.get(wish) if isinstance(wish, int) else wish
        assert env.unwrapped.episode == (expected,)


@each_family
def test_the_start_is_the_episodes(make, env_id):
    env = make(env_id)
    env.reset(options={"episode": 2})
    (episode,) = env.unwrapped.episode
    (state,) = env.unwrapped.privileged()
    assert np.allclose(state.arm_qpos, episode.robot.arm_qpos_rad, atol=1e-5)
    assert np.allclose(state.world_from_base[:2, 3], episode.robot.base[:2], atol=1e-5)
    for name, pose in episode.objects.items():
        assert np.allclose(state.world_from_body[name][:3, 3], pose[:3], atol=1e-5)


@each_family
def test_episodes_end_at_the_horizon(make, env_id):
    """Long ones at a shorter one, which is given as ManiSkill's and Gymnasium's users do."""
    horizon = HORIZONS.get(env_id, 200)
    assert gym.spec(env_id).max_episode_steps == ENVS[env_id].horizon_steps == horizon
    long = horizon > 200
    env = make(env_id, **({"max_episode_steps": 30} if long else {}))
    env.reset(seed=0)
    steps = 30 if long else horizon
    truncated = [bool(env.step(still(env))[3]) for _ in range(steps)]
    assert truncated == [False] * (steps - 1) + [True]


# Actions ---------------------------------------------------------------------------------------


def bad_actions(space):
    """Actions that are refused: not finite, of another shape, no numbers, no cells."""
    if isinstance(space, spaces.Discrete):
        yield from (space.n, -1, 3.5, np.nan, np.inf, -np.inf, np.int64(10**12))
        yield from ([1, 2], [[3, 4]], [[[5]]], [])
    else:
        (size,) = space.shape
        for value in (np.nan, np.inf, -np.inf):
            for entry in range(size):
                bad = np.zeros(size, dtype=np.float32)
                bad[entry] = value
                yield bad
        yield np.array([np.inf, -np.inf, *np.zeros(size - 2)], dtype=np.float32)
        yield np.full(size, 1e300)  # infinite as float32
        for shape in ((size + 1,), (size - 1,), (2, size), (1, 1, size), (0,), ()):
            yield np.zeros(shape, dtype=np.float32)
    yield from ("forward", ["a"] * 4, {"arm": 1.0}, object())


@every_mode
def test_a_bad_action_is_refused_and_nothing_moves(make, env_id, mode):
    env = make(env_id, control_mode=mode)
    env.reset(seed=0)
    play(env, actions(env, 3))
    before, elapsed = env.unwrapped.get_state_dict(), env.unwrapped.elapsed_steps.clone()
    for bad in bad_actions(env.unwrapped.single_action_space):
        with pytest.raises(ActionError):
            env.step(bad)
    assert same(env.unwrapped.get_state_dict(), before)
    assert torch.equal(env.unwrapped.elapsed_steps, elapsed)


@every_mode_costly
def test_actions_out_of_range_are_clipped(make, env_id, mode):
    if mode == "base_discrete":
        return  # a cell is known or refused
    ends = []
    for factor in (1.0, 7.0):
        env = make(env_id, control_mode=mode)
        env.reset(seed=0)
        high = env.action_space.high
        for entry in (0, len(high) - 1):
            action = np.zeros(len(high)) if "target" not in mode else still(env)
            action[entry] = factor * high[entry]
            env.step(action.astype(np.float32))
        ends.append(env.unwrapped.get_state_dict())
    assert same(*ends)


ARM_ENVS = ("HabPick-v1", "HabOpenFridge-v1", "HabSetTable-v1")
"""The arm alone, with the base of a skill, with the base of a task."""


@pytest.mark.parametrize("env_id", ARM_ENVS)
def test_an_ee_action_moves_the_hand_by_one_and_a_half_centimetres(make, env_id):
    env = make(env_id)
    env.reset(seed=0)
    kinematics = env.unwrapped.agent.controller._kinematics
    # Forwards, left and down: upwards a shoulder at its limit shortens the way.
    for axis, sign in enumerate((1.0, 1.0, -1.0)):
        action = still(env)
        action[axis] = sign
        before = kinematics.position(arm(env.unwrapped).astype(float))
        env.step(action)
        moved = kinematics.position(arm(env.unwrapped).astype(float)) - before
        # Damping takes a little off; within a tenth.
        assert np.linalg.norm(moved - 0.015 * action[:3]) < 0.0015


@pytest.mark.parametrize("env_id", ARM_ENVS)
def test_a_joint_action_moves_each_joint_by_its_share(make, env_id):
    env = make(env_id, control_mode=ENVS[env_id].env.control_modes[1])
    env.reset(seed=0)
    before = arm(env.unwrapped)
    # Towards zero, away from the joints' limits.
    entries = -np.sign(before) * np.array([1, 1, 0.5, 0, 0.25, 0.5, 1], dtype=np.float32)
    action = still(env)
    action[:7] = entries
    env.step(action)
    # 0.0125 rad times the entry
    assert np.allclose(arm(env.unwrapped) - before, 0.0125 * entries, atol=1e-6)


@pytest.mark.parametrize(
    ("env_id", "mode"),
    [
        ("HabNavigate-v1", "base"),
        ("HabNavigate-v1", "base_discrete"),
        ("HabOpenFridge-v1", "ee_base"),
        ("HabSetTable-v1", "joint_target_base"),
    ],
)
def test_the_base_turns_and_stands_still_as_the_action_says(make, env_id, mode):
    """Largest turning speed 3.14 rad/s: 3.14 / 30 = 0.1047 rad an action, once it turns."""
    env = make(env_id, control_mode=mode)
    env.reset(seed=0)
    base = env.unwrapped

    def turned(share, steps=6):
        action = still(env)
        if mode == "base_discrete":
            action = BASE_CELLS.index((0.0, share))
        else:
            action[-1] = share
        for _ in range(steps):
            before = np.asarray(base._simulation.snapshot.base)[0].copy()
            env.step(action)
        return np.asarray(base._simulation.snapshot.base)[0] - before

    assert turned(1.0)[2] == pytest.approx(0.1047, rel=0.01)
    assert turned(-0.5)[2] == pytest.approx(-0.0523, rel=0.01)
    assert bool(base.agent.controller.stopped) is False
    assert np.allclose(turned(0.0), 0.0, atol=1e-4)
    assert bool(base.agent.controller.stopped) is True
    assert BASE_CELLS[STOP_CELL] == (0.0, 0.0)


def test_each_mode_has_the_entries_that_the_paper_gives_it():
    """Arm 3 or 7 and the gripper, the base 2, 3 for a pose; 20 cells (S E.3, H.2)."""
    arm = {"ee": 4, "joint_delta": 8, "joint_target": 8, "joint_state": 8}
    sizes = {"base": 2, "base_discrete": 2, **arm}
    sizes |= {f"{mode}_base": size + 2 for mode, size in arm.items()}
    sizes |= {f"{mode}_pose": size + 3 for mode, size in arm.items()}
    for env in ENVS.values():
        for mode in env.env.control_modes:
            config = control_configs()[mode]
            assert config.size == sizes[mode]
            assert ARM_SIZE[config.arm] in (0, 3, 7)
    assert len(BASE_CELLS) == 20


def test_an_unknown_control_mode_names_the_nearest(make):
    for env_id, entry in ENVS.items():
        known = entry.env.control_modes[-1]
        with pytest.raises(UnknownNameError, match=f"Did you mean '{known}'"):
            make(env_id, control_mode=f"{known[:-1]}x")


def test_every_arm_mode_has_a_twin_that_moves_the_base():
    modes = control_configs()
    endings = {"still": "", "velocity": "_base", "pose": "_pose"}
    for name, config in modes.items():
        if config.arm != "still":
            assert name == config.arm + endings[config.base]
            assert modes[config.arm].base == "still"
            assert modes[f"{config.arm}_base"].base == "velocity"
