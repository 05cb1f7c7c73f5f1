"""Policy server: any agent behind the protocol of openpi or vla-eval.

Each connection has its own agent of one row. The server listens on the loopback interface unless
told otherwise, and then only with a token.
"""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import os
import threading
import time
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

import torch
from torch import Tensor
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response
from websockets.sync.server import Server, ServerConnection, serve

from hab_eval.errors import AgentError
from hab_eval.integrations.messages import PROMPT, MessageReader, spec_params
from hab_eval.integrations.protocols import (
    MOST_BYTES,
    PROTOCOLS,
    TOKEN_VARIABLE,
    RemoteError,
    event,
    pack,
    read_event,
    unpack,
)
from hab_eval.run.agent_checks import check_actions, check_report, check_reports, without_exit
from hab_eval.run.agents import load_agent
from hab_eval.run.environments import agent_seed, make_setup
from hab_tasks.agent import Agent
from hab_tasks.agent_spaces import state_entries
from hab_tasks.envs import ENVS
from hab_tasks.errors import HabError, OptionError, UnknownNameError
from hab_tasks.io.threads import use_one_thread
from hab_tasks.option_values import whole
from hab_tasks.registration import imported_id

LARGEST_PORT = 65535
MOST_CONNECTIONS = 64
LARGEST_SEED = 2**31 - 1
"""Seeds of agents have 31 bits."""


@dataclass(frozen=True, kw_only=True)
class ServeOptions:
    """What is served, and where.

    Attributes:
        agent: ``module:factory``.
        env: Environment id.
        protocol: ``openpi`` or ``vla-eval``.
        host: Address of the interface to listen on.
        port: Port; 0 picks a free one.
        options: Options of the agent.
        seed: Seed of the run, as for `hab-eval run`.
        device: Device of the agent's networks.
    """

    agent: str
    env: str
    protocol: str
    host: str = "127.0.0.1"
    port: int = 8000
    options: Mapping[str, str] = field(default_factory=dict)
    seed: int = 0
    device: str = "cpu"

    def __post_init__(self) -> None:
        if self.protocol not in PROTOCOLS:
            raise UnknownNameError("protocol", self.protocol, PROTOCOLS)
        whole("port", self.port, 0, LARGEST_PORT)
        if not _is_loopback(self.host) and not os.environ.get(TOKEN_VARIABLE):
            raise OptionError(
                f"--host {self.host} is reachable from other machines; set a token in "
                f"{TOKEN_VARIABLE}, or serve on 127.0.0.1."
            )


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class PolicyServer:
    """Serves an agent.

    Attributes:
        name: Name of the agent.
        address: Where it listens.
    """

    def __init__(self, options: ServeOptions) -> None:
        """Loads the agent and starts to listen; `run` answers.

        Raises:
            HabError: The agent cannot be loaded or served, or the port is taken.
        """
        use_one_thread()
        self._options, self._env = options, imported_id(options.env)
        setup = make_setup(self._env, agent_seed(options.seed), options.options, options.device)
        self._load = lambda: load_agent(options.agent, setup)
        agent = self._load()
        if agent.spec.privileged:
            raise AgentError(f"{options.agent} reads the true state, which is not sent to servers.")
        spec, spaces = agent.spec, setup.spaces(agent.spec)
        env = ENVS[self._env].env
        entries = state_entries(env, spec, env.robot)
        prompt = PROMPT[options.protocol]
        self._reader = MessageReader(spec, entries, spaces.observation, prompt)
        self._idle, self._lock, self._count = [agent], threading.Lock(), 0
        self._open: set[ServerConnection] = set()
        self._open_lock, self._closed = threading.Lock(), False
        self._token = os.environ.get(TOKEN_VARIABLE)
        self._about = {"agent": spec.name, "env": self._env}
        self._about |= {"observation_params": spec_params(spec), "protocol_version": 1}
        self._server = self._listen()
        self.name = spec.name
        host = f"[{options.host}]" if ":" in options.host else options.host
        self.address = f"ws://{host}:{self._server.socket.getsockname()[1]}"

    def run(self) -> None:
        """Answers requests until `close`."""
        self._server.serve_forever()

    def close(self) -> None:
        """Stops listening, and ends all connections."""
        self._server.shutdown()
        # Before version 17 of websockets, `shutdown` leaves the connections open.
        with self._open_lock:
            self._closed, left = True, list(self._open)
        for connection in left:
            connection.close(CloseCode.GOING_AWAY)

    def _listen(self) -> Server:
        options = self._options
        try:
            return serve(
                self._handle,
                options.host,
                options.port,
                compression=None,
                max_size=MOST_BYTES,
                max_queue=1,  # messages in memory
                origins=[None],  # no pages of a browser
                ping_interval=None,
                process_request=self._checked_request,
            )
        except OSError as error:
            reason = error.strerror or str(error)
            where = f"{options.host}:{options.port}"
            raise OptionError(
                f"Cannot listen on {where}: {reason}; choose another --port."
            ) from error

    def _checked_request(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answers requests for the server's health, and those without the token."""
        parts = urlsplit(request.path)
        if parts.path in ("/health", "/healthz"):
            return connection.respond(HTTPStatus.OK, '{"status": "ok"}\n')
        if self._token is None:
            return None
        # vla-eval sends no headers; its address may end in ?token=...
        given = parse_qs(parts.query).get("token", [""])[-1]
        given = request.headers.get("Authorization", "").removeprefix("Api-Key ") or given
        if hmac.compare_digest(given.encode(), self._token.encode()):
            return None
        return connection.respond(HTTPStatus.UNAUTHORIZED, f"The token of {TOKEN_VARIABLE}.\n")

    def _handle(self, connection: ServerConnection) -> None:
        """Serves one connection until it is closed."""
        with self._open_lock:
            if self._closed:
                return
            self._open.add(connection)
        try:
            self._answer(connection)
        finally:
            with self._open_lock:
                self._open.discard(connection)

    def _answer(self, connection: ServerConnection) -> None:
        """Answers a connection; errors are reported to the client, which ends it."""
        openpi = self._options.protocol == "openpi"
        seq = [0]
        try:
            with self._agent() as agent:
                session = _Session(agent, self._reader, self._lock)
                if openpi:
                    self._serve_openpi(connection, session)
                else:
                    self._serve_vla_eval(connection, session, seq)
        except ConnectionClosed:
            pass
        except Exception as error:  # of the agent; the server goes on
            text = str(error) if isinstance(error, HabError) else f"{type(error).__name__}: {error}"
            message = text if openpi else self._packed(event("error", {"error": text}, seq[0]))
            with contextlib.suppress(ConnectionClosed):
                connection.send(message)

    def _serve_openpi(self, connection: ServerConnection, session: _Session) -> None:
        connection.send(self._packed(self._about))
        for message in connection:
            request = unpack(message)
            step = request.get("step") if isinstance(request, dict) else None
            if step == 0 or not session.started:
                session.start(request.get("seed") if isinstance(request, dict) else None)
            began_s = time.perf_counter()
            reply = session.act(request)
            infer_ms = 1000.0 * (time.perf_counter() - began_s)
            reply |= {"actions": reply["actions"][None], "server_timing": {"infer_ms": infer_ms}}
            connection.send(self._packed(reply))

    def _serve_vla_eval(
        self, connection: ServerConnection, session: _Session, seq: list[int]
    ) -> None:
        for message in connection:
            kind, payload, seq[0] = read_event(message)
            if kind == "hello":
                connection.send(self._packed(event("hello", self._about, seq[0])))
            elif kind == "episode_start":
                task = payload.get("task")
                session.start(task.get("seed") if isinstance(task, dict) else None)
            elif kind == "observation":
                if not session.started:
                    session.start(None)
                connection.send(self._packed(event("action", session.act(payload), seq[0])))

    def _packed(self, value: Any) -> bytes:
        return pack(value, self._options.protocol)

    @contextlib.contextmanager
    def _agent(self) -> Generator[Agent, None, None]:
        """Yields an agent of one's own; one that is idle, or a new one."""
        with self._lock:
            if self._count >= MOST_CONNECTIONS:
                raise RemoteError(f"{MOST_CONNECTIONS} connections are open; no more are served.")
            self._count += 1
            agent = self._idle.pop() if self._idle else None
        try:
            if agent is None:
                with self._lock:
                    agent = self._load()
            yield agent
        finally:
            with self._lock:
                self._count -= 1
                if agent is not None:
                    self._idle.append(agent)


class _Session:
    """Episodes of one connection."""

    def __init__(self, agent: Agent, reader: MessageReader, lock: threading.Lock) -> None:
        self._agent, self._reader, self._lock = agent, reader, lock
        self.started = False

    def start(self, seed: Any) -> None:
        """Starts an episode; a client that sends no seed gets 0."""
        seed = 0 if seed is None else whole("seed", seed, 0, LARGEST_SEED)
        with self._lock, without_exit():
            self._agent.reset(torch.ones(1, dtype=torch.bool), [seed])
        self.started = True

    def act(self, message: Any) -> dict[str, Any]:
        """Returns the reply to an observation: the action (A,), and the agent's report."""
        obs = self._reader.read(message)
        # Agents may share state of their module, e.g. buffers of compiled code.
        with self._lock, without_exit():
            actions: Tensor = check_actions(self._agent.act(obs), 1)
            name = self._agent.spec.name
            (report,) = check_reports(self._agent.report(), 1, name)
            failure, _ = check_report(report, name)
        found: dict[str, Any] = {"actions": actions[0].numpy()}
        found |= {"failure": failure} if failure else {}
        return found | ({"doing": report.doing} if report.doing else {})
