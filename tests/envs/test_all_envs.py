"""All environments in all control modes: spaces, rewards, purity, determinism, invalid actions."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from builders import same
from gymnasium import spaces
from playing import FAMILIES, actions, arm, each_family, flat, play, slow, still

from hab_tasks.envs import ENVS
from hab_tasks.errors import ActionError, EpisodeError
from hab_tasks.robots.control_modes import BASE_CELLS

HORIZONS = {"HabNavigate-v1": 500, "HabTidyHouse-v1": 5000}
HORIZONS |= {"HabPrepareGroceries-v1": 4000, "HabSetTable-v1": 4500}
"""Of the others it is 200 (S H.2, G.2)."""

WHOLE = ("HabPick-v1", "HabNavigate-v1")
"""Played in all control modes by the quick tests; of the other families in the first one."""

MODES = {e: entry.env.control_modes for e, entry in ENVS.items()}
QUICK_MODES = [(e, MODES[e] if e in WHOLE else MODES[e][:1]) for e in FAMILIES]
SLOW_MODES = [(e, MODES[e][e in FAMILIES :]) for e in ENVS if e not in WHOLE]
every_mode = pytest.mark.parametrize(
    ("env_id", "modes"), [*QUICK_MODES, *(pytest.param(*case, marks=slow) for case in SLOW_MODES)]
)

ONE_MODE = [(e, names[(i + 1) % len(names)]) for i, (e, names) in enumerate(MODES.items())]
"""Every environment in one more mode; those of different environments differ."""

one_mode = pytest.mark.parametrize(
    ("env_id", "mode"),
    [("HabPick-v1", "ee"), *(pytest.param(*case, marks=slow) for case in ONE_MODE)],
)


@every_mode
def test_steps_are_as_declared_and_looks_and_bad_actions_change_nothing(make, env_id, modes):
    for mode in modes:
        env = make(env_id, obs_mode="state_dict", control_mode=mode)
        obs, _ = env.reset(seed=0)
        check_observation(env, env_id, obs)
        for obs, reward, terminated, truncated, info in play(env, actions(env, 40)):
            check_observation(env, env_id, obs)
            assert reward.shape == terminated.shape == (1,), mode
            assert torch.isfinite(reward).all(), mode
            terms = torch.stack(tuple(info["reward_terms"].values()))
            assert torch.allclose(terms.sum(0), reward), mode
            assert bool(terminated) == bool(info["success"] | info["fail"]), mode
            assert bool(info["fail"]) == any(bool(f) for f in info["failures"].values()), mode
            assert not (info["success"] & info["fail"]), mode
            assert not truncated or int(info["elapsed_steps"]) == ENVS[env_id].horizon_steps
        check_looking(env, mode)
        check_bad_actions(env, mode)


def check_observation(env, env_id, obs):
    for name, value in flat(obs):
        assert np.isfinite(value.numpy()).all(), name
        assert value.dtype == torch.float32, name
    for group, entries in env.observation_space.items():
        for key, space in entries.items():
            assert space.contains(obs[group][key].numpy()), (group, key)
    shapes = {name.rsplit("/", 1)[-1]: tuple(value.shape[1:]) for name, value in flat(obs)}
    assert shapes == {e.name: e.shape for e in ENVS[env_id].env.observation}


def check_looking(env, mode):
    base = env.unwrapped
    before = base.get_state_dict()
    first, second = ({"told": base.evaluate(), "obs": base.get_obs()} for _ in range(2))
    base.privileged()
    assert same(first, second), mode
    assert same(base.get_state_dict(), before), mode


def check_bad_actions(env, mode):
    env.reset(seed=0)
    play(env, actions(env, 3))
    before, elapsed = env.unwrapped.get_state_dict(), env.unwrapped.elapsed_steps.clone()
    for bad in bad_actions(env.unwrapped.single_action_space):
        with pytest.raises(ActionError):
            env.step(bad)
    assert same(env.unwrapped.get_state_dict(), before), mode
    assert torch.equal(env.unwrapped.elapsed_steps, elapsed), mode


def bad_actions(space):
    """Actions that are refused: not finite, of another shape, no numbers, no cells."""
    if isinstance(space, spaces.Discrete):
        yield from (space.n, -1, 3.5, np.nan, -np.inf, np.int64(10**12), [1, 2], [[3, 4]], [])
    else:
        (size,) = space.shape
        for entry in range(size):
            yield np.where(np.arange(size) == entry, (np.nan, np.inf, -np.inf)[entry % 3], 0.0)
        yield np.full(size, 1e300)  # infinite as float32
        for shape in ((size + 1,), (size - 1,), (2, size), (1, 1, size), (0,), ()):
            yield np.zeros(shape, dtype=np.float32)
    yield from ("forward", ["a"] * 4, {"arm": 1.0}, object())


@each_family
def test_flat_state_is_all_entries_in_order(make, env_id):
    state, parts = (make(env_id, obs_mode=m).reset(seed=3)[0] for m in ("state", "state_dict"))
    values = {name.rsplit("/", 1)[-1]: value for name, value in flat(parts)}
    in_order = [values[entry.name] for entry in ENVS[env_id].env.observation]
    assert torch.equal(state, torch.cat(in_order, dim=1))


def test_reset_pays_and_ends_nothing(make):
    for env_id in ENVS:
        env = make(env_id)
        for index in range(2):
            _, info = env.reset(options={"episode": index})
            assert "reconfigure" in info
            found = env.unwrapped.evaluate()
            assert not found["success"] | found["fail"], (env_id, index)
            assert not any(found["reward_terms"].values()), (env_id, index)


@each_family
def test_other_reward_modes_follow_from_the_dense_one(make, env_id):
    """Normalized: divided by its bound; sparse: 1 for success, -1 for failure; none: 0."""
    runs = {}
    for mode in ("dense", "normalized_dense", "sparse", "none"):
        env = make(env_id, reward_mode=mode)
        env.reset(seed=1)
        steps = play(env, actions(env, 30))
        runs[mode] = torch.cat([step[1].float() for step in steps])
        ends = torch.cat([step[-1]["success"].float() - step[-1]["fail"].float() for step in steps])
    assert runs["dense"].any()
    expected = (runs["dense"] / ENVS[env_id].env.reward_bound).clamp(max=1.0)
    assert torch.allclose(runs["normalized_dense"], expected)
    assert torch.equal(runs["sparse"], ends)
    assert not runs["none"].any()


def two_episodes(env, count, options):
    """What two episodes of up to `count` random actions show, step for step."""
    found = []
    for seed in (4, 6):
        obs, _ = env.reset(seed=seed, options=dict(options))
        found.append({"obs": obs})
        for obs, reward, *_, info in play(env, actions(env, count, seed=seed)):
            found.append({"obs": obs, "reward": reward, "measures": info["measures"]})
    return found


@one_mode
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


def test_a_seed_chooses_the_episode_and_the_later_ones(make):
    def order(env, seed):
        env.reset(seed=seed)
        ids = [env.unwrapped.episode[0].id]
        for _ in range(8):
            env.reset()
            ids.append(env.unwrapped.episode[0].id)
        return ids

    first, second = make(), make()
    first.reset()
    assert order(first, 3) == order(second, np.int64(3)) == order(first, 3) != order(first, 4)
    assert len({order(first, seed)[0] for seed in range(12)}) > 3


@each_family
def test_the_start_is_the_episodes(make, env_id):
    """Asked for by its index, or itself."""
    env = make(env_id)
    source = env.unwrapped.simulation.source
    for wish in (2, source.get(5)):
        expected = source.get(wish) if isinstance(wish, int) else wish
        env.reset(options={"episode": wish})
        assert env.unwrapped.episode == (expected,)
        (state,) = env.unwrapped.privileged()
        assert np.allclose(state.arm_qpos, expected.robot.arm_pose(env.unwrapped.robot), atol=1e-5)
        assert np.allclose(state.world_from_base[:2, 3], expected.robot.base[:2], atol=1e-5)
        for name, pose in expected.objects.items():
            assert np.allclose(state.world_from_body[name][:3, 3], pose[:3], atol=1e-5)


def test_an_episode_outside_the_set_is_refused(make):
    """The file has eight, of which five are played: 0 to 4."""
    env = make(num_episodes=5)
    for wish in (5, -1, 10**7):
        message = rf"Episode {wish}: valid indices are 0 to 4"
        with pytest.raises(EpisodeError, match=message) as caught:
            env.reset(options={"episode": wish})
        # The file's sixth one can be had.
        assert ("num_episodes=6" in str(caught.value)) == (wish == 5)
    with pytest.raises(EpisodeError, match="'7' is neither an index nor an Episode"):
        env.reset(options={"episode": "7"})
    env.reset(options={"episode": 4})


def test_episodes_end_at_the_horizon_of_the_paper(make):
    """A task's at a shorter one, which is given as ManiSkill's and Gymnasium's users do."""
    for env_id, entry in ENVS.items():
        horizon = HORIZONS.get(env_id, 200)
        assert gym.spec(env_id).max_episode_steps == entry.horizon_steps == horizon, env_id
    for env, steps in ((make(), 200), (make("HabSetTable-v1", max_episode_steps=30), 30)):
        env.reset(seed=0)
        truncated = [bool(env.step(still(env))[3]) for _ in range(steps)]
        assert truncated == [False] * (steps - 1) + [True]


def test_actions_out_of_range_are_clipped(make):
    for env_id, mode in (("HabPick-v1", "ee"), ("HabNavigate-v1", "base")):
        env, ends = make(env_id, control_mode=mode), []
        for factor in (1.0, 7.0):
            env.reset(seed=0, options={"reconfigure": True})
            for entry in (0, -1):
                action = np.zeros_like(env.action_space.high)
                action[entry] = factor * env.action_space.high[entry]
                env.step(action)
            ends.append(env.unwrapped.get_state_dict())
        assert same(*ends), env_id


@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabOpenFridge-v1", "HabSetTable-v1"])
def test_a_joint_action_moves_each_joint_by_its_share(make, env_id):
    """The arm alone, with the base of a skill, with the base of a task."""
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
    ("env_id", "mode"), [("HabNavigate-v1", "base_discrete"), ("HabOpenFridge-v1", "ee_base")]
)
def test_the_base_turns_and_stands_still_as_the_action_says(make, env_id, mode):
    """Largest turning speed 3.14 rad/s: 3.14 / 30 = 0.1047 rad an action, once it turns."""
    env = make(env_id, control_mode=mode)
    env.reset(seed=0)
    base = env.unwrapped
    for share, turned_rad in ((1.0, 0.1047), (-0.5, -0.0523), (0.0, 0.0)):
        action = still(env)
        if mode == "base_discrete":
            action = BASE_CELLS.index((0.0, share))
        else:
            action[-1] = share
        for _ in range(6):
            before = np.asarray(base.simulation.snapshot.base)[0].copy()
            env.step(action)
        moved = np.asarray(base.simulation.snapshot.base)[0] - before
        assert moved[2] == pytest.approx(turned_rad, rel=0.01, abs=1e-4)
        assert bool(base.agent.controller.stopped) == (share == 0.0)
    assert np.allclose(moved, 0.0, atol=1e-4)
