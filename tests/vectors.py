"""Vector environments in tests: rollouts, and the single environments that they have to equal."""

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode

MAX_STEPS = 25
EPISODES = 8
"""Short episodes, of few: all autoreset modes occur in a few dozen steps."""


def make_vec(env_id: str, num_envs: int, **options: Any) -> Any:
    """A vector environment with short episodes."""
    options = {"max_episode_steps": MAX_STEPS, "num_episodes": EPISODES, **options}
    return gym.make_vec(f"hab_tasks:{env_id}", num_envs=num_envs, **options)


def flat(value: Any, path: str = "") -> dict[str, Any]:
    """Nested dicts as one, by path; entries of one row lose the batch dimension."""
    if isinstance(value, dict):
        parts = (flat(inner, f"{path}/{name}") for name, inner in value.items())
        return {name: entry for part in parts for name, entry in part.items()}
    return {path: np.asarray(value)}


def alone(value: Any) -> dict[str, Any]:
    """`flat` of a single environment's tensors (1, ...), without what only single ones report."""
    rest = ("/instruction", "/reconfigure")
    return {name: x[0] for name, x in flat(value).items() if name not in rest}


def info_keys(env_id: str, **options: Any) -> list[str]:
    """All entries of `info` that a vector environment can have."""
    env = gym.make(f"hab_tasks:{env_id}", num_episodes=EPISODES, **options)
    _, info = env.reset(seed=0)
    env.close()
    return [
        name
        for name, value in info.items()
        if isinstance(value, torch.Tensor) or (isinstance(value, dict) and value)
    ]


def sampled_actions(space: Any, rows: int, steps: int, seed: int = 0) -> np.ndarray:
    """Random actions (steps, rows, ...), each repeated for five steps."""
    rng = np.random.default_rng(seed)
    if hasattr(space, "n"):
        drawn = [rng.integers(space.n, size=rows) for _ in range(steps)]
    else:
        drawn = [
            rng.uniform(space.low, space.high, (rows, *space.shape)).astype(np.float32)
            for _ in range(steps)
        ]
    return np.stack([drawn[step - step % 5] for step in range(steps)])


@dataclass
class Rollout:
    """What a vector environment returned: the reset, and each step with its actions.

    In the mode `DISABLED`, entries of `steps` may be resets: (observation, info).
    """

    first: tuple[Any, Any]
    steps: list[tuple[Any, ...]]
    actions: np.ndarray


def roll_out(env: Any, steps: int, seed: int) -> Rollout:
    """Resets and steps, and resets what has ended where nothing else does."""
    first = env.reset(seed=seed)
    actions = sampled_actions(env.single_action_space, env.num_envs, steps)
    found: list[tuple[Any, ...]] = []
    for action in actions:
        if env.autoreset_mode is AutoresetMode.DISABLED and found:
            ended = found[-1][2] | found[-1][3]
            if ended.any():
                found.append(env.reset(options={"reset_mask": ended}))
        found.append(env.step(action))
    return Rollout(first, found, actions)


def assert_row(got: Any, row: int, wanted: Any, where: str) -> None:
    """A row equals a single environment's tensors, bit for bit and in type."""
    entries = flat(got)
    for name, value in alone(wanted).items():
        found = entries[name][row]
        assert found.dtype == value.dtype, f"{where}: {name}"
        assert np.array_equal(found, value), f"{where}: {name} is {found}, not {value}"


def repeated(single: Any, action: Any, times: int) -> tuple[Any, ...]:
    """Repeats an action until the episode ends, at most some times; the rewards are summed."""
    total = torch.zeros(1)
    for _ in range(times):
        obs, reward, terminated, truncated, info = single.step(action)
        total = total + reward
        if bool(terminated) or bool(truncated):
            break
    return obs, total, terminated, truncated, info


def assert_equals_single(
    env: Any, rolled: Rollout, row: int, single: Any, seed: int, times: int = 1
) -> None:
    """Replays a row of a rollout in a single environment; everything is equal."""
    mode = env.autoreset_mode
    obs, info = single.reset(seed=seed)
    assert_row(rolled.first[0], row, obs, "reset")
    assert_row(rolled.first[1], row, info, "reset info")
    ended, step = False, -1
    for entry in rolled.steps:
        if len(entry) == 2:
            if ended:
                obs, info = single.reset()
                ended = False
            assert_row(entry[0], row, obs, f"reset after step {step}")
            continue
        step += 1
        seen, reward, terminated, truncated, infos = entry
        if ended and mode is AutoresetMode.NEXT_STEP:
            obs, info = single.reset()
            assert (reward[row], terminated[row], truncated[row]) == (0.0, False, False)
            ended = False
        else:
            action = rolled.actions[step][row]
            obs, single_reward, won_or_lost, over, info = repeated(single, action, times)
            assert np.array_equal(reward[row], single_reward.numpy()[0])
            assert (terminated[row], truncated[row]) == (bool(won_or_lost), bool(over))
            ended = bool(won_or_lost) or bool(over)
            if ended and mode is AutoresetMode.SAME_STEP:
                last = flat(infos["final_obs"][row])
                for name, value in alone(obs).items():
                    assert np.array_equal(last[name], value), f"final observation: {name}"
                assert_row(infos["final_info"], row, info, "final info")
                obs, info = single.reset()
                ended = False
        assert_row(seen, row, obs, f"step {step}")
        assert_row(infos, row, info, f"info of step {step}")
