"""One rank of a toy run: `python ppo_rank.py FILE MODE...` with torchrun's variables."""

import copy
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from hab_ppo.collect import Collector
from hab_ppo.distillation import Visits, distill, visit
from hab_ppo.distributed import Ranks
from hab_ppo.network import new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.ppo import PPO
from hab_ppo.recipe import FAST, Cloning, Distillation, NetworkConfig, PPOConfig
from toy_vector import ToyVector

ROWS, STEPS, SLOW_S = 8, 40, 0.1


def run_ranks(size: int, folder: Path, *modes: str) -> list[dict[str, Any]]:
    """Runs `size` ranks; returns what each wrote, by mode."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    paths = [str(Path(__file__).parent), *sys.path]
    shared = os.environ | {
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(port),
        "WORLD_SIZE": str(size),
        "LOCAL_WORLD_SIZE": str(size),
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "OMP_NUM_THREADS": "1",
    }
    files = [folder / f"{size}_{rank}.pt" for rank in range(size)]
    processes = [
        subprocess.Popen(
            [sys.executable, __file__, str(file), *modes],
            env=shared | {"RANK": str(rank), "LOCAL_RANK": str(rank)},
        )
        for rank, file in enumerate(files)
    ]
    try:
        assert [process.wait(timeout=300) for process in processes] == [0] * size
    finally:
        for process in processes:
            process.kill()
    return [torch.load(file, weights_only=True) for file in files]


def toy_rank(config: PPOConfig, ranks: Ranks, rows: int) -> tuple[PPO, Collector]:
    """A learner with an LSTM, the same in all ranks, and rows to collect from."""
    env = ToyVector(rows)
    layout = ObservationLayout.of(env.single_observation_space)
    network = NetworkConfig(lstm_size=8, head_layers=(16,))
    policy = new_policy(layout, env.single_action_space, network, seed=5)
    return PPO(policy, config, ranks), Collector(env, policy, ranks, STEPS)


def gradients(ranks: Ranks) -> dict[str, Any]:
    """Learns from this rank's share of the rows; all processes make the same rollout."""
    config = PPOConfig(
        epochs=1, minibatches=1, max_gradient_norm=1e9, scales_rewards=True, entropy_weight=0.01
    )
    learner, _ = toy_rank(config, ranks, ROWS)
    alone = Ranks.__new__(Ranks)
    alone.rank, alone.size, alone.device, alone._store = 0, 1, ranks.device, None
    collector = Collector(ToyVector(ROWS), learner.policy, alone, STEPS)
    collector.reset(list(range(ROWS)))
    whole, _ = collector.collect(0, torch.Generator().manual_seed(0))
    rows = torch.arange(ROWS).tensor_split(ranks.size)[ranks.rank]
    metrics = learner.update(whole.of_rows(rows), torch.Generator().manual_seed(0), 0.0)
    found = {name: value.grad for name, value in learner.policy.named_parameters()}
    return {"gradients": found, "metrics": metrics, "state": learner.policy.state_dict()}


def preemption(ranks: Ranks) -> dict[str, Any]:
    """Two updates in which the last rank is slow."""
    learner, collector = toy_rank(FAST.ppo, ranks, ROWS)
    collector.reset([100 * ranks.rank + row for row in range(ROWS)])
    step = collector.env.step

    def slow(actions: Any) -> Any:
        time.sleep(SLOW_S if ranks.rank == ranks.size - 1 else 0)
        return step(actions)

    collector.env.step = slow
    lengths = []
    for update in range(2):
        generator = torch.Generator().manual_seed(10 * update + ranks.rank)
        rollout, _ = collector.collect(update, generator)
        lengths.append(len(rollout.rewards))
        learner.update(rollout, generator, 0.0)
    return {"lengths": torch.tensor(lengths), "state": learner.policy.state_dict()}


class Walker:
    """A teacher that walks to the goal as fast as it can."""

    def labels(self, obs: Any, starts: torch.Tensor) -> Any:
        """See `hab_ppo.distillation.Teacher`."""
        gap = np.asarray(obs["extra"]["goal"]) - np.asarray(obs["agent"]["position"])
        return np.clip(gap / 0.2, -1, 1).astype(np.float32)


def distillation(ranks: Ranks) -> dict[str, Any]:
    """Two rounds; only the first rank's student is the one that learns."""
    env, lines = ToyVector(ROWS), []
    layout = ObservationLayout.of(env.single_observation_space)
    network = NetworkConfig(head_layers=(16,))
    student = new_policy(layout, env.single_action_space, network, seed=ranks.rank)
    config = Distillation(teacher="", rounds=2, round_steps=300, cloning=Cloning(epochs=1))
    kept = [copy.deepcopy(student.state_dict())]

    def keep(done: int) -> None:
        kept.append(copy.deepcopy(student.state_dict()))

    distill(student, Walker(), env, config, 0, ranks, lines.append, keep=keep)
    own = visit(student, Walker(), env, 10 * ranks.rank + 10, 0.0, [0])
    steps = [
        sum(len(part.state) for part in Visits.read(data).parts)
        for data in ranks.to_first(own.written())
    ]
    rounds = [int(line.split("episodes, ")[1].split(" ")[0]) for line in lines if "round" in line]
    return {"rounds": rounds, "steps": steps, "kept": kept, "state": student.state_dict()}


MODES = {"gradients": gradients, "preemption": preemption, "distillation": distillation}

if __name__ == "__main__":
    torch.set_num_threads(1)
    joined = Ranks()
    found = {mode: MODES[mode](joined) for mode in sys.argv[2:]}
    joined.close()
    torch.save(found, sys.argv[1])
