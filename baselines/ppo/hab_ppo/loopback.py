"""Rendezvous of ranks on this machine, which no other machine can reach.

The stores that torchrun makes listen on all interfaces, whatever their endpoint says, and anyone
who reaches one can write to it.
"""

from __future__ import annotations

import os
import socket

from torch._C._distributed_c10d import PrefixStore, TCPStore
from torch.distributed.elastic.rendezvous import RendezvousHandler, RendezvousInfo
from torch.distributed.elastic.rendezvous.api import (
    RendezvousParameters,
    RendezvousStoreInfo,
    rendezvous_handler_registry,
)

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
