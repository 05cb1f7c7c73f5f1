"""Suite train of ``hab-eval bench``: training steps per second of blind Pick on two ranks.

References, measured in turn with it: the vector environment stepping alone with random actions,
and RecurrentPPO of sb3-contrib where it is installed, with the same LSTM, heads, rollouts,
minibatches and epochs as the run that it is compared with. It plays the same rows in two workers,
or two single environments in two processes (its own `SubprocVecEnv`). All play the apartment's
training episodes, whatever the dataset of the command.
"""

from __future__ import annotations

import importlib.util
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from hab_eval.bench.report import BenchRow, make_row
from hab_eval.bench.suite import PICK, BenchOptions, Suite, WriteLine
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from torch import nn

from hab_ppo.progress import read_progress
from hab_ppo.recipe import NetworkConfig
from hab_ppo.recipes.pick import PICK_BLIND
from hab_tasks.errors import RunStoppedError
from hab_tasks.io.threads import use_one_thread
from hab_tasks.vector.sb3 import SB3VecEnv

RANKS, EPISODES, UPDATES = 2, 50, 3
"""Of the updates of a run, all but the first are timed."""

LSTM_SIZE = 128
RECURRENT = replace(
    PICK_BLIND,
    name="pick_blind_recurrent",
    preset=replace(PICK_BLIND.preset, network=NetworkConfig(lstm_size=LSTM_SIZE, log_std=-0.5)),
)
"""`pick_blind` with an LSTM, as RecurrentPPO has one."""

STEPPING = "the vector environment stepping alone, random actions"
SB3_ROWS = "RecurrentPPO of sb3-contrib on the same rows"
SB3_PROCESSES = "RecurrentPPO of sb3-contrib on two environments in a SubprocVecEnv"
Measure = Callable[[], float]


def run_train(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures training and its references in turn."""
    steps = options.step_count
    ours = {"ranks": lambda: trained("pick_blind", steps)}
    others: dict[str, Measure] = {}
    with ExitStack() as stack:
        env = stack.enter_context(closing(vector_env("NextStep")))
        env.reset(seed=0)
        others["ranks"] = lambda: stepped(env, steps)
        names = {"ranks": ("2_ranks", STEPPING)}
        if importlib.util.find_spec("sb3_contrib"):
            for key, make, reference in (
                ("rows", sb3_rows, SB3_ROWS),
                ("processes", sb3_processes, SB3_PROCESSES),
            ):
                ours[key] = lambda: trained("hab_ppo.bench_train:RECURRENT", steps)
                learner = stack.enter_context(closing(Sb3Learner(make(), steps)))
                others[key] = learner.measure
                names[key] = (f"2_ranks_and_sb3_{key}", reference)
        else:
            write_line("sb3-contrib is not installed: its rows are left out")
        rows = []
        for key, (variant, reference) in names.items():
            pairs = alternated(ours[key], others[key], options.repeats, write_line)
            values = [one for one, _ in pairs], [other for _, other in pairs]
            name = ("train", "apartment", PICK, variant)
            rows.append(make_row(name, *values, unit="steps/s", reference=reference))
    return rows


def alternated(
    ours: Measure, other: Measure, repeats: int, write_line: WriteLine
) -> list[tuple[float, float]]:
    """Returns pairs of steps/s, measured in turn; the reference warms up first."""
    other()
    pairs = []
    for repeat in range(repeats):
        pairs.append((ours(), other()))
        write_line(f"repeat {repeat + 1}: {pairs[-1][0]:.0f} steps/s, reference {pairs[-1][1]:.0f}")
    return pairs


def trained(recipe: str, steps: int) -> float:
    """Returns the steps/s of a short training run, without its start and evaluation.

    Args:
        recipe: Name of the recipe.
        steps: Steps of each row in an update.
    """
    rows = RANKS * PICK_BLIND.preset.rows
    # Dead steps after an episode do not count, so the last update may take the run past its end.
    total = (UPDATES - 1) * rows * steps + 1
    with tempfile.TemporaryDirectory(prefix="hab_bench_") as folder:
        command = [
            *(sys.executable, "-m", "hab_ppo", "train", recipe, "--out", f"{folder}/run"),
            *("--ranks", str(RANKS), "--steps", str(total), "--episodes", str(EPISODES)),
            *("--rollout-steps", str(steps), "--evaluation-steps", str(10 * total)),
            *("--evaluation-episodes", str(RANKS)),
        ]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if done.returncode:
            raise RunStoppedError("A training run of the benchmark failed.", details=done.stderr)
        entries = read_progress(Path(folder) / "run")
    return statistics.median(entry["time/steps_per_s"] for entry in entries[1:])


def env_options() -> dict[str, Any]:
    """Returns the options of the environment on all sides."""
    return PICK_BLIND.env.options() | {"num_episodes": EPISODES}


def vector_env(mode: str, **options: Any) -> Any:
    """Returns the rows of all ranks in one vector environment, with a worker for each rank."""
    return gym.make_vec(
        PICK_BLIND.env.reference,
        num_envs=RANKS * PICK_BLIND.preset.rows,
        num_workers=RANKS,
        autoreset_mode=mode,
        **(env_options() | options),
    )


def stepped(env: Any, steps: int) -> float:
    """Returns the steps/s of a vector environment with random actions."""
    drawn = np.random.default_rng(0)
    shape = (env.num_envs, *env.single_action_space.shape)
    actions = drawn.uniform(-1, 1, (steps, *shape)).astype(np.float32)
    began = time.perf_counter()
    for action in actions:
        env.step(action)
    return env.num_envs * steps / (time.perf_counter() - began)


def sb3_rows() -> Any:
    """Returns the rows of all ranks for Stable-Baselines3."""
    return SB3VecEnv(vector_env("SameStep", obs_mode="state"))


def sb3_processes() -> Any:
    """Returns a single environment in each of two processes, for Stable-Baselines3."""
    # An optional package, as is sb3_contrib.
    from stable_baselines3.common.vec_env import SubprocVecEnv

    return SubprocVecEnv([make_single] * RANKS, start_method="spawn")


def make_single() -> gym.Env[Any, Any]:
    """Makes a single environment in its process."""
    use_one_thread()
    options: dict[str, Any] = env_options() | {"obs_mode": "state"}
    return CPUGymWrapper(gym.make(PICK_BLIND.env.reference, **options))


class Sb3Learner:
    """RecurrentPPO with the network and the update of `RECURRENT`."""

    def __init__(self, env: Any, steps: int) -> None:
        # Optional, as above.
        from sb3_contrib import RecurrentPPO  # pyright: ignore[reportMissingImports]

        preset = RECURRENT.preset
        heads = list(preset.network.head_layers)
        self._env, self._batch = env, RANKS * preset.rows * steps
        self._model = RecurrentPPO(
            "MlpLstmPolicy",
            env,
            n_steps=self._batch // env.num_envs,
            batch_size=self._batch // preset.ppo.minibatches,
            n_epochs=preset.ppo.epochs,
            learning_rate=preset.ppo.learning_rate,
            policy_kwargs={
                "lstm_hidden_size": LSTM_SIZE,
                "shared_lstm": True,
                "enable_critic_lstm": False,
                "net_arch": {"pi": heads, "vf": heads},
                "activation_fn": nn.Tanh,
            },
            device="cpu",
            seed=0,
        )

    def measure(self) -> float:
        """Returns the steps/s of one update with its rollout."""
        began = time.perf_counter()
        self._model.learn(self._batch, reset_num_timesteps=False)
        return self._batch / (time.perf_counter() - began)

    def close(self) -> None:
        """Ends its processes."""
        self._env.close()


SUITE = Suite(name="train", run=run_train, steps=200)
