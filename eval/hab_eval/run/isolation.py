"""Agents in processes of their own, for `hab-eval run --isolated`.

Such a process has neither an environment nor the evaluator's state, and is told neither the run's
seed nor its episodes. What it answers is read as JSON and plain numbers, since unpickling could
run the agent's code in the evaluator. It is no sandbox: it may read what the user may read.
"""

from __future__ import annotations

import contextlib
import json
import struct
import sys
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hab_eval.errors import AgentError
from hab_eval.records.config import EvalConfig, robot_asked
from hab_eval.records.schema import read_dataclass
from hab_eval.run.agent_checks import (
    check_actions,
    check_report,
    check_reports,
    check_spec,
    without_exit,
)
from hab_eval.run.agents import load_agent
from hab_eval.run.environments import agent_seed, make_setup, setup_of
from hab_eval.run.observations import LazyBatch, LazyObservation
from hab_tasks.agent import Agent, AgentReport, AgentSpec, of_rows
from hab_tasks.errors import HabError, RunStoppedError
from hab_tasks.io.pool import Worker
from hab_tasks.privileged import CollisionBody, PrivilegedState
from hab_tasks.typed_values import parse_json, to_json

PRIVILEGED = "privileged"
"""Key of the true state in an observation."""


class ObsPacker:
    """Packs observations of rows.

    The bodies of a true state are megabytes of meshes. They are sent once for each row and scene.
    """

    def __init__(self) -> None:
        """Starts with a receiver that has no bodies."""
        self._scene_keys: dict[int, str] = {}

    def pack(self, obs: Any, rows: Sequence[int] = (0,)) -> Any:
        """Returns the observation of these rows as a message for `ObsUnpacker`."""
        message = packed(obs)
        states = _true_states(message)
        if states:
            pairs = zip(rows, states, strict=True)
            message[PRIVILEGED] = [self._without_known_bodies(*pair) for pair in pairs]
        return message

    def _without_known_bodies(self, row: int, state: PrivilegedState) -> PrivilegedState:
        known = self._scene_keys.get(row) == state.scene_key
        self._scene_keys[row] = state.scene_key
        return replace(state, bodies=()) if known else state


class ObsUnpacker:
    """Unpacks observations of rows."""

    def __init__(self) -> None:
        """Starts without bodies."""
        self._bodies: dict[int, tuple[CollisionBody, ...]] = {}

    def unpack(self, message: Any, rows: Sequence[int] = (0,)) -> Any:
        """Returns the observation of these rows that `ObsPacker` packed."""
        obs = unpacked(message)
        states = _true_states(obs)
        if states:
            pairs = zip(rows, states, strict=True)
            obs[PRIVILEGED] = [self._with_bodies(*pair) for pair in pairs]
        return obs

    def _with_bodies(self, row: int, state: PrivilegedState) -> PrivilegedState:
        self._bodies[row] = state.bodies or self._bodies[row]
        return replace(state, bodies=self._bodies[row])


def packed(value: Any) -> Any:
    """Converts tensors of nested groups to arrays; tensors would be sent by shared memory."""
    if isinstance(value, Mapping):
        return {name: packed(part) for name, part in value.items()}
    return value.numpy() if isinstance(value, Tensor) else value


def unpacked(value: Any) -> Any:
    """Inverse of `packed`."""
    if isinstance(value, Mapping):
        return {name: unpacked(part) for name, part in value.items()}
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value


def _true_states(obs: Any) -> Sequence[PrivilegedState]:
    """Returns the true state of each row, or nothing."""
    return obs.get(PRIVILEGED, ()) if isinstance(obs, Mapping) else ()


ACTIONS, JSON = b"A", b"J"
"""First byte of an answer."""

DTYPES = "?bBhilqefd"
"""Characters of the dtypes that actions may have."""

HEAD = struct.Struct("=cII")
"""Dtype, rows and entries of actions."""

_Ask = Callable[[str, Sequence[int]], Mapping[str, Any]]
"""Reads a group of the observation of some rows from the evaluator."""


def start_agent(config: EvalConfig, device: str) -> Worker:
    """Starts a process that loads the agent."""
    seed, robot = agent_seed(config.seed), robot_asked(config.env_options)
    return Worker(_serve, config.agent, config.env, seed, config.options, device, robot)


@contextlib.contextmanager
def opened_agent(config: EvalConfig, device: str) -> Generator[Agent, None, None]:
    """Yields the agent of a run, in this process or in one of its own.

    Raises:
        HabError: The agent cannot be loaded.
    """
    if not config.isolated:
        yield load_agent(config.agent, setup_of(config, device))
        return
    process = start_agent(config, device)
    try:
        yield IsolatedAgent(process.connection, config.agent)
    finally:
        process.end()


class IsolatedAgent:
    """An agent in another process.

    Attributes:
        spec: Its spec.
    """

    def __init__(self, connection: Connection, reference: str) -> None:
        """Waits until the agent is loaded.

        Raises:
            HabError: It cannot be.
        """
        self._connection, self._reference = connection, reference
        self._packer = ObsPacker()
        self._count = 0
        self.spec = self._read_spec(self._receive_json())

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """See `Agent.reset`."""
        self._count = len(mask)
        self._send(("reset", mask.numpy(), list(seeds)))
        self._receive_json()

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """See `Agent.act`."""
        lazy = isinstance(obs, LazyObservation | LazyBatch)
        unread = obs.unread if lazy else ()
        ready = {name: obs[name] for name in obs if name not in unread} if lazy else obs
        self._send(("act", self._packer.pack(ready, range(self._count)), unread))
        while (answer := self._receive())[:1] != ACTIONS:
            group, rows = self._wanted(_parse(answer, self._reference), unread)
            self._send(self._packer.pack({group: of_rows(obs, rows)[group]}, rows))
        return _unpack_actions(answer, self._reference)

    def report(self) -> list[AgentReport]:
        """See `Agent.report`."""
        self._send(("report",))
        where = f"report of agent {self._reference}"
        reports = self._receive_json()
        if not isinstance(reports, list):
            raise AgentError(f"{where} is no list.")
        return [read_dataclass(AgentReport, one, where) for one in reports]

    def _wanted(self, request: Any, unread: Sequence[str]) -> tuple[str, list[int]]:
        """Returns the group and the rows that the agent reads."""
        with contextlib.suppress(TypeError, ValueError):
            group, rows = request
            if group in unread and set(rows) <= set(range(self._count)):
                return group, rows
        raise AgentError(f"The agent {self._reference} read what its observation does not have.")

    def _read_spec(self, data: Any) -> AgentSpec:
        try:
            cameras = None if data["cameras"] is None else tuple(data["cameras"])
            spec = AgentSpec(**{**data, "files": tuple(data["files"]), "cameras": cameras})
        except (KeyError, TypeError) as error:
            raise AgentError(f"{self._reference}: its process sent no spec.") from error
        check_spec(spec, self._reference)
        return spec

    def _send(self, message: Any) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._connection.send(message)  # if it has ended, so says what is received

    def _receive_json(self) -> Any:
        return _parse(self._receive(), self._reference)

    def _receive(self) -> bytes:
        try:
            return self._connection.recv_bytes()
        except (EOFError, OSError) as error:
            raise AgentError(f"The process of the agent {self._reference} ended.") from error


class _AskedObservation(LazyObservation):
    """An observation in the agent's process; the evaluator reads a group when it is asked for."""

    def __init__(
        self, ready: Mapping[str, Any], unread: Sequence[str], ask: _Ask, rows: Sequence[int]
    ) -> None:
        super().__init__(ready, {name: partial(ask, name, rows) for name in unread})
        self._ask, self._rows = ask, rows
        self._parts: list[_AskedObservation] = []

    def of_rows(self, rows: Sequence[int]) -> Mapping[str, Any]:
        chosen = [self._rows[row] for row in rows]
        part = _AskedObservation(of_rows(self._groups, rows), self.unread, self._ask, chosen)
        self._parts.append(part)
        return part

    def expire(self) -> None:
        super().expire()
        for part in self._parts:
            part.expire()


def _serve(
    connection: Connection,
    reference: str,
    env_id: str,
    seed: int,
    options: Mapping[str, str],
    device: str,
    robot: str | None,
) -> None:
    """Main function of an agent's process; runs until the evaluator closes the pipe."""
    sys.argv[1:] = []  # the run's seed is among them
    with contextlib.suppress(EOFError, ConnectionError):
        try:
            agent = load_agent(reference, make_setup(env_id, seed, options, device, robot))
            _answer(connection, to_json(agent.spec))
            _serve_calls(connection, agent)
        except (EOFError, ConnectionError):
            raise  # the run is over
        except RunStoppedError as error:
            _answer(connection, {"stopped": str(error), "details": error.details})
        except HabError as error:
            _answer(connection, {"refused": str(error)})
        except Exception as error:
            details = traceback.format_exc()
            _answer(connection, {"raised": f"{type(error).__name__}: {error}", "details": details})


def _serve_calls(connection: Connection, agent: Agent) -> None:
    """Passes the evaluator's calls on."""
    unpacker, count = ObsUnpacker(), 0

    def ask(group: str, rows: Sequence[int]) -> Mapping[str, Any]:
        _answer(connection, [group, list(rows)])
        return unpacker.unpack(connection.recv(), rows)

    while True:
        name, *arguments = connection.recv()
        with without_exit():
            if name == "reset":
                mask, seeds = arguments
                count = len(mask)
                agent.reset(torch.from_numpy(mask), seeds)
                _answer(connection, None)
            elif name == "act":
                message, unread = arguments
                ready = unpacker.unpack(message, range(count))
                obs = _AskedObservation(ready, unread, ask, range(count))
                actions = check_actions(agent.act(obs if unread else ready), count)
                obs.expire()
                connection.send_bytes(_pack_actions(actions))
            else:
                _answer(connection, to_json(_checked(agent, count)))


def _checked(agent: Agent, count: int) -> list[AgentReport]:
    """Returns an agent's reports, with numbers that JSON has."""
    name = agent.spec.name
    reports = check_reports(agent.report(), count, name)
    told = [check_report(report, name) for report in reports]
    return [
        replace(report, failure=failure, timings_s=timings_s)
        for report, (failure, timings_s) in zip(reports, told, strict=True)
    ]


def _answer(connection: Connection, value: Any) -> None:
    connection.send_bytes(JSON + json.dumps(value, allow_nan=False).encode())


def _parse(answer: bytes, reference: str) -> Any:
    """Returns an answer in JSON; raises the error that it tells of."""
    try:
        value = parse_json(answer[1:].decode())
    except ValueError as error:
        raise AgentError(f"The process of the agent {reference} sent no JSON: {error}") from error
    if isinstance(value, dict) and "refused" in value:
        raise HabError(str(value["refused"]))
    if isinstance(value, dict) and "stopped" in value:
        raise RunStoppedError(str(value["stopped"]), details=str(value.get("details")))
    if isinstance(value, dict) and "raised" in value:
        error = AgentError(f"{reference}: {value['raised']}")
        error.add_note(str(value.get("details")))
        raise error
    return value


def _pack_actions(actions: Tensor) -> bytes:
    """Returns actions (N, A) as bytes."""
    array = (actions.float() if actions.dtype is torch.bfloat16 else actions).numpy()
    head = HEAD.pack(array.dtype.char.encode(), *array.shape)
    return ACTIONS + head + array.tobytes()


def _unpack_actions(answer: bytes, reference: str) -> Tensor:
    """Inverse of `_pack_actions`."""
    try:
        kind, rows, entries = HEAD.unpack_from(answer, 1)
        if kind.decode() not in DTYPES:
            raise ValueError(kind)
        array = np.frombuffer(answer, np.dtype(kind.decode()), offset=1 + HEAD.size)
        return torch.from_numpy(array.reshape(rows, entries).copy())
    except (struct.error, TypeError, ValueError) as error:
        raise AgentError(f"The process of the agent {reference} sent no actions.") from error
