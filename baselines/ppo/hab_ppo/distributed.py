"""DD-PPO: ranks that learn together, each with its own environments (S App. C.2).

Every rank has a learner of its own. Gradients and moments are summed over the ranks, so all of
them stay equal. A rank stops its rollout early once enough of the others have finished theirs
(preemption); they count in the process group's key-value store.

torchrun's elastic agent starts the ranks of one machine. The stores that it makes listen on all
interfaces, whatever their endpoint says, and anyone who reaches one can write to it; the
rendezvous here is one that no other machine can reach.
"""

from __future__ import annotations

import os
import socket
import sys
import time
import uuid
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta

import torch
import torch.distributed as dist
from torch import Tensor
from torch._C._distributed_c10d import TCPStore
from torch.distributed.distributed_c10d import PrefixStore, Store
from torch.distributed.elastic.multiprocessing.api import SignalException
from torch.distributed.elastic.multiprocessing.errors import ChildFailedError
from torch.distributed.elastic.rendezvous import RendezvousHandler, RendezvousInfo
from torch.distributed.elastic.rendezvous.api import (
    RendezvousParameters,
    RendezvousStoreInfo,
    rendezvous_handler_registry,
)
from torch.distributed.launcher.api import LaunchConfig, elastic_launch
from torch.distributed.rendezvous import rendezvous

from hab_ppo.normalizer import Moments
from hab_tasks.errors import RunStoppedError

PREEMPTION_SHARE = 0.6
"""Share of the ranks that have to be done before the others are stopped (S App. C.2)."""

LEAST_SHARE = 0.25
"""Share of its rollout that a rank always completes, as in Habitat."""

POLL_S = 0.02
"""Time between two looks at the store."""

TIMEOUT = timedelta(hours=12)
"""Ranks may wait for the first one to make demonstrations or distil."""


class Ranks:
    """All ranks of a run; without torchrun, only this process.

    Attributes:
        rank: Number of this rank.
        size: Number of ranks.
        device: Torch device of the learner.
    """

    def __init__(self) -> None:
        """Joins the ranks that torchrun started, if it did."""
        self.rank, self.size = 0, 1
        self.device = self._wire = torch.device("cpu")
        self._store: Store | None = None
        if "WORLD_SIZE" not in os.environ:
            return
        if torch.cuda.is_available():
            cards = torch.cuda.device_count()
            self.device = torch.device("cuda", int(os.environ["LOCAL_RANK"]) % cards)
            torch.cuda.set_device(self.device)
            if int(os.environ["LOCAL_WORLD_SIZE"]) <= cards:  # NCCL wants a card for each rank
                self._wire = self.device
        store, self.rank, self.size = next(rendezvous("env://", timeout=TIMEOUT))
        store = PrefixStore(common_name(store, self.rank, self.size), store)
        self._store = PrefixStore("hab_ppo", store)
        dist.init_process_group(
            "nccl" if self._wire.type == "cuda" else "gloo",
            store=PrefixStore("group", store),
            rank=self.rank,
            world_size=self.size,
            timeout=TIMEOUT,
        )

    @property
    def is_first(self) -> bool:
        """Whether this rank writes the files."""
        return self.rank == 0

    @property
    def on_machine(self) -> int:
        """Number of ranks on this machine."""
        return int(os.environ.get("LOCAL_WORLD_SIZE", "1")) if self.size > 1 else 1

    def close(self) -> None:
        """Leaves the group."""
        if dist.is_initialized():
            dist.destroy_process_group()

    def sum(self, values: Tensor) -> Tensor:
        """Returns the sum of a tensor over all ranks."""
        if self.size == 1:
            return values
        # A copy, as the sum is made in place and callers keep their own part.
        total = values.to(self._wire, copy=True)
        dist.all_reduce(total)
        return total.to(values.device)

    def merged(self, moments: Moments) -> Moments:
        """Returns the moments of the samples of all ranks together."""
        if self.size == 1:
            return moments
        own = moments.packed().to(self._wire)
        parts = [torch.empty_like(own) for _ in range(self.size)]
        dist.all_gather(parts, own)
        total = Moments.unpacked(parts[0])
        for part in parts[1:]:
            total = total.merged(Moments.unpacked(part))
        return Moments(*(value.to(moments.mean.device) for value in total))

    def from_first(self, data: bytes) -> bytes:
        """Returns the bytes that the first rank has."""
        if self.size == 1:
            return data
        size = torch.tensor([len(data)], device=self._wire)
        dist.broadcast(size, 0)
        content = torch.zeros(int(size), dtype=torch.uint8, device=self._wire)
        if self.is_first:
            content.copy_(torch.frombuffer(bytearray(data), dtype=torch.uint8))
        dist.broadcast(content, 0)
        return content.cpu().numpy().tobytes()

    def to_first(self, data: bytes) -> list[bytes]:
        """Returns the bytes of all ranks, in their order, at the first one; nothing elsewhere."""
        if self.size == 1:
            return [data]
        if not self.is_first:
            dist.send(torch.tensor([len(data)], device=self._wire), 0)
            dist.send(torch.frombuffer(bytearray(data), dtype=torch.uint8).to(self._wire), 0)
            return []
        found = [data]
        for other in range(1, self.size):
            size = torch.zeros(1, dtype=torch.int64, device=self._wire)
            dist.recv(size, other)
            content = torch.zeros(int(size), dtype=torch.uint8, device=self._wire)
            dist.recv(content, other)
            found.append(content.cpu().numpy().tobytes())
        return found

    @property
    def is_first_on_machine(self) -> bool:
        """Whether this rank starts the processes that make episodes for those on its machine."""
        return self.size == 1 or os.environ.get("LOCAL_RANK", "0") == "0"

    def meet(self) -> None:
        """Waits for all ranks."""
        if self.size > 1:
            dist.barrier()

    def sum_gradients(self, parameters: Iterable[Tensor]) -> None:
        """Replaces gradients by their sums over all ranks."""
        if self.size == 1:
            return
        gradients = [parameter.grad for parameter in parameters if parameter.grad is not None]
        # One message, as each of dozens of small ones would wait for the slowest rank.
        flat = torch.cat([gradient.flatten() for gradient in gradients]).to(self._wire)
        dist.all_reduce(flat)
        first = 0
        for gradient in gradients:
            gradient.copy_(flat[first : first + gradient.numel()].view_as(gradient))
            first += gradient.numel()

    def finish_rollout(self, update: int) -> None:
        """Tells the others that this rank has finished its rollout of an update."""
        if self._store is not None:
            self._store.add(f"finished/{update}", 1)

    def preempts(self, update: int, step: int, steps: int) -> bool:
        """Whether this rank has to stop its rollout before step `step` of `steps`."""
        if self._store is None or self.size == 1 or step < LEAST_SHARE * steps:
            return False
        # Adding 0 reads the counter; `get` would block until the first rank has finished.
        return self._store.add(f"finished/{update}", 0) >= PREEMPTION_SHARE * self.size


def common_name(store: Store, rank: int, size: int) -> str:
    """Returns a name on which the ranks agree, and which no ranks before them have had.

    torchrun keeps its store when it restarts the ranks, with the keys of those that were killed:
    without a new name, ranks would connect to addresses that no longer exist.
    """
    own = uuid.uuid4().hex
    if rank > 0:
        store.set(f"asks/{rank}", own)
        name = store.get(f"answer/{own}").decode()
        store.set(f"knows/{name}/{rank}", "")
        return name
    for other in range(1, size):
        while not store.check([f"knows/{own}/{other}"]):
            if store.check([f"asks/{other}"]):  # perhaps still that of a rank that was killed
                store.set(f"answer/{store.get(f'asks/{other}').decode()}", own)
            time.sleep(POLL_S)
    return own


MOST_RESTARTS = 3
PREPARED = "HAB_PPO_PREPARED"
"""Set for ranks whose output folder has been checked, and emptied, by their launcher."""


def is_rank() -> bool:
    """Whether this process is one of several ranks, started by torchrun."""
    return "WORLD_SIZE" in os.environ


def is_prepared() -> bool:
    """Whether this rank may continue what is in the output folder: it is of this very run."""
    return PREPARED in os.environ or os.environ.get("TORCHELASTIC_RESTART_COUNT", "0") != "0"


def launch(ranks: int, arguments: Sequence[str]) -> None:
    """Runs ``hab-ppo`` with these arguments in several ranks, restarted if one is killed.

    Raises:
        RunStoppedError: A rank failed.
    """
    os.environ[PREPARED] = "1"
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    config = LaunchConfig(
        min_nodes=1,
        max_nodes=1,
        nproc_per_node=ranks,
        run_id=uuid.uuid4().hex,
        rdzv_backend=use_loopback(),
        max_restarts=MOST_RESTARTS,
        monitor_interval=0.5,
    )
    try:
        elastic_launch(config, sys.executable)("-m", "hab_ppo", *arguments)
    except SignalException as error:  # Ctrl-C and SIGTERM, which the agent catches
        raise KeyboardInterrupt from error
    except ChildFailedError as error:
        rank, failure = error.get_first_failure()
        raise RunStoppedError(
            f"Rank {rank} ended with status {failure.exitcode}; its message is above. --resume "
            "continues from the last update."
        ) from error
    finally:
        del os.environ[PREPARED]


BACKEND = "hab_loopback"
LOOPBACK = "127.0.0.1"
INTERFACE_VARIABLES = ("GLOO_SOCKET_IFNAME", "NCCL_SOCKET_IFNAME")
"""Environment variables that name the interface of the ranks' connections."""


class LoopbackRendezvous(RendezvousHandler):
    """One node, whose store listens on the loopback interface; restarted ranks use it again."""

    def __init__(self, run_id: str) -> None:
        """Starts the store on a free port."""
        self._run_id = run_id
        listening = socket.create_server((LOOPBACK, 0))
        self._port = listening.getsockname()[1]
        self._store = TCPStore(
            LOOPBACK,
            self._port,
            is_master=True,
            wait_for_workers=False,
            master_listen_fd=listening.detach(),
        )

    def get_backend(self) -> str:
        """Returns the name of this rendezvous in torch's registry."""
        return BACKEND

    @property
    def use_agent_store(self) -> bool:
        """Returns True: ranks connect to the store of this process."""
        return True

    def next_rendezvous(self) -> RendezvousInfo:
        """Returns the store, at once: this node is the only one."""
        store = PrefixStore(self._run_id, self._store)
        return RendezvousInfo(store, 0, 1, RendezvousStoreInfo(LOOPBACK, self._port))

    def is_closed(self) -> bool:
        """Returns False: ranks may be restarted at any time."""
        return False

    def set_closed(self) -> None:
        """Does nothing."""

    def num_nodes_waiting(self) -> int:
        """Returns 0: no other node joins."""
        return 0

    def get_run_id(self) -> str:
        """Returns the run's id."""
        return self._run_id

    def shutdown(self) -> bool:
        """Returns True; the store ends with this process."""
        return True


def _handler(parameters: RendezvousParameters) -> LoopbackRendezvous:
    return LoopbackRendezvous(parameters.run_id)


def use_loopback() -> str:
    """Keeps the connections of ranks on this machine; returns the rendezvous backend to use.

    Interfaces that the environment names already stay as they are.
    """
    names = [name for _, name in socket.if_nameindex()]
    interface = "lo" if "lo" in names else "lo0"
    for variable in INTERFACE_VARIABLES:
        os.environ.setdefault(variable, interface)
    rendezvous_handler_registry.register(BACKEND, _handler)
    return BACKEND


@contextmanager
def compute_threads(count: int) -> Iterator[None]:
    """Lets PyTorch compute in so many threads for a while."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
