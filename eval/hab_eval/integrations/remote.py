"""Agent ``hab_eval:remote``: a policy in another process, behind a WebSocket.

A server of this package tells the observations and the control mode that its agent needs. For other
servers they are options; by default the policy sees colour images and the task's instruction, and
no target positions.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar
from urllib.parse import urlsplit

import numpy as np
import torch
from torch import Tensor
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from hab_eval.integrations.messages import (
    PROMPT,
    SPEC_FIELDS,
    parse_params,
    to_message,
    with_params,
)
from hab_eval.integrations.protocols import (
    IMAGE_FORMATS,
    MOST_BYTES,
    NUMBERS,
    PROTOCOLS,
    TOKEN_VARIABLE,
    RemoteError,
    event,
    pack,
    read_event,
    unpack,
)
from hab_eval.run.environments import continuous_control
from hab_tasks.agent import Agent, AgentReport, AgentSetup, AgentSpec, check_options
from hab_tasks.errors import OptionError, shown
from hab_tasks.option_values import number, whole
from hab_tasks.registration import imported_id

T = TypeVar("T")

IMAGE_SIZE_PX = 224
"""Image size that most vision-language-action models take."""

TIMEOUT_S, RECONNECT_S = 60.0, 60.0
RETRY_S = 0.5
LONGEST_S = 86400.0
LONGEST_TEXT = 300
MOST_ACTIONS = 10_000

OPTIONS = {
    **dict.fromkeys(SPEC_FIELDS),
    **dict.fromkeys(("address", "timeout_s", "reconnect_s", "horizon")),
    "protocol": PROTOCOLS,
    "images": IMAGE_FORMATS,
}
"""Option -> valid values, None if they are checked elsewhere."""


class ConnectionLostError(RemoteError):
    """The server cannot be reached, or has closed the connection."""


class Link:
    """A connection to a server of one protocol; reconnects between episodes.

    Attributes:
        about: What the server has told of itself.
    """

    def __init__(self, address: str, protocol: str, timeout_s: float, images: str) -> None:
        """Connects.

        Raises:
            RemoteError: The server cannot be reached, or refuses the connection.
        """
        self._address, self._protocol, self._timeout_s = address, protocol, timeout_s
        self._images, self._seq, self._episode = images, 0, {}
        self._connection: ClientConnection | None = None
        self._closing = contextlib.ExitStack()
        self.about = self._connect()

    def start(self, seed: int, env: str) -> None:
        """Starts an episode, at the next request."""
        self._episode = {"seed": seed, "env": env, "step": 0}

    def act(self, message: dict[str, Any]) -> dict[str, Any]:
        """Returns the reply to an observation.

        Raises:
            ConnectionLostError: The connection is lost.
            RemoteError: The server reports an error, is late, or its reply is invalid.
        """
        first = self._episode["step"] == 0
        try:
            with self._failures():
                if self._protocol == "openpi":
                    reply = self._asked({**message, **self._episode})
                else:
                    if first:
                        task = {"name": self._episode["env"], "seed": self._episode["seed"]}
                        self._send_event("episode_start", {"task": task})
                    reply = self._exchanged("observation", message, "action")
        except ConnectionLostError as error:
            step = self._episode["step"] + 1
            raise ConnectionLostError(f"{str(error).rstrip('.')} (request {step}).") from error
        self._episode["step"] += 1
        return reply

    @property
    def is_fresh(self) -> bool:
        """Whether the episode has had no request, so that another server may take it."""
        return self._episode["step"] == 0

    def reconnect(self, wait_s: float) -> None:
        """Connects again, and waits for the server up to `wait_s`.

        Raises:
            RemoteError: It does not come back, or serves another agent.
        """
        deadline_s = time.monotonic() + wait_s
        while True:
            try:
                about = self._connect()
                break
            except ConnectionLostError:
                if time.monotonic() > deadline_s:
                    raise
                time.sleep(RETRY_S)
        if about != self.about:
            raise RemoteError(f"The server {self._address} serves another policy than before.")

    def _connect(self) -> dict[str, Any]:
        """Connects; returns what the server tells of itself."""
        with contextlib.suppress(Exception):
            self._closing.close()
        token = os.environ.get(TOKEN_VARIABLE)
        headers = {"Authorization": f"Api-Key {token}"} if token else None
        with self._failures():
            opening = connect(
                self._address,
                additional_headers=headers,
                compression=None,
                max_size=MOST_BYTES,
                max_queue=1,  # messages in memory
                open_timeout=self._timeout_s,
                close_timeout=1.0,
                ping_interval=None,  # a policy may hold its interpreter for long
                proxy=None,
            )
            self._closing.enter_context(opening)
            self._connection = opening
            if self._protocol == "openpi":
                about = unpack(self._received())
            else:
                about = self._exchanged("hello", {"protocol_version": 1}, "hello")
        if not isinstance(about, dict):
            raise RemoteError(f"{self._address} told {shown(about)}; is it {self._protocol}?")
        return about

    def _asked(self, message: dict[str, Any]) -> dict[str, Any]:
        """Sends an observation of openpi; returns the reply."""
        self._open().send(pack(message, self._protocol))
        reply = self._received()
        if isinstance(reply, str):
            raise RemoteError(self._reported(reply))
        found = unpack(reply)
        if not isinstance(found, dict):
            raise RemoteError(f"The server {self._address} sent {shown(found)}; a map is valid.")
        return found

    def _exchanged(self, kind: str, payload: dict[str, Any], wanted: str) -> dict[str, Any]:
        """Sends a message of vla-eval; returns the payload of the reply to it."""
        sent = self._send_event(kind, payload)
        while True:
            found, reply, seq = read_event(self._received())
            if found == "error":
                raise RemoteError(self._reported(str(reply.get("error", reply))))
            if found == wanted and seq == sent:
                return reply

    def _send_event(self, kind: str, payload: dict[str, Any]) -> int:
        self._seq += 1
        message = event(kind, payload, self._seq)
        self._open().send(pack(message, self._protocol, self._images))
        return self._seq

    def _open(self) -> ClientConnection:
        assert self._connection is not None
        return self._connection

    def _received(self) -> str | bytes:
        return self._open().recv(timeout=self._timeout_s)

    def _reported(self, text: str) -> str:
        short = " ".join(text.split())
        short = short if len(short) <= LONGEST_TEXT else f"...{short[-LONGEST_TEXT:]}"
        return f"The server {self._address} reports: {short.rstrip('.')}."

    @contextlib.contextmanager
    def _failures(self) -> Any:
        """Converts exceptions of the connection into errors of one line."""
        try:
            yield
        except TimeoutError as error:
            message = f"The server {self._address} did not answer within {self._timeout_s:g} s."
            raise RemoteError(message) from error
        except InvalidStatus as error:
            status = error.response.status_code
            hint = f"; its token has to be in {TOKEN_VARIABLE}" if status == 401 else ""
            raise RemoteError(
                f"{self._address} refused with HTTP status {status}{hint}."
            ) from error
        except InvalidHandshake as error:
            raise RemoteError(f"{self._address} is no WebSocket server: {error}.") from error
        except ConnectionClosed as error:
            message = f"The server {self._address} has closed the connection."
            raise ConnectionLostError(message) from error
        except OSError as error:
            reason = error.strerror or str(error)
            message = f"The server {self._address} cannot be reached: {reason}."
            raise ConnectionLostError(message) from error


class RemoteAgent:
    """An agent of one row that asks a server for its actions, and plays them one by one."""

    def __init__(self, setup: AgentSetup) -> None:
        """Connects to the server.

        Raises:
            HabError: An option is invalid, or the server cannot be reached.
        """
        check_options(setup, OPTIONS)
        options, self._env = setup.options, imported_id(setup.env_id)
        protocol = _required(options, "protocol")
        images = options.get("images", "raw")
        if images == "png" and protocol == "openpi":
            raise OptionError.of_value("--option images", images, "raw; openpi has no PNG images")
        self._horizon = _read(options, "horizon", None, _horizon)
        timeout_s = _read(options, "timeout_s", TIMEOUT_S, _seconds)
        self._reconnect_s = _read(options, "reconnect_s", RECONNECT_S, _seconds)
        params = parse_params(options)
        self._link = Link(_address(_required(options, "address")), protocol, timeout_s, images)
        self._prompt = PROMPT[protocol]
        self.spec = with_params(_spec_of(self._link.about, self._env), params)
        self._actions: list[Tensor] = []
        self._report = AgentReport()
        self._seconds = 0.0

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts an episode; the server learns it with the first observation."""
        self._link.start(int(seeds[0]), self._env)
        self._actions, self._report, self._seconds = [], AgentReport(), 0.0

    def act(self, obs: Any) -> Tensor:
        """Returns the next action (1, A), for which the server is asked if none is left."""
        if not self._actions:
            began_s = time.perf_counter()
            reply = self._reply(to_message(obs, self._prompt))
            self._actions = _chunk(reply.get("actions"))[: self._horizon]
            self._seconds += time.perf_counter() - began_s
            self._report = _report_of(reply, self._seconds)
        return self._actions.pop(0)

    def report(self) -> list[AgentReport]:
        """Returns the time spent on the server, and what the server reports."""
        return [self._report]

    def _reply(self, message: dict[str, Any]) -> dict[str, Any]:
        try:
            return self._link.act(message)
        except ConnectionLostError:
            if not self._link.is_fresh:
                raise  # the policy's memory of this episode is lost
        self._link.reconnect(self._reconnect_s)
        return self._link.act(message)


def remote(setup: AgentSetup) -> Agent:
    """Returns an agent whose policy is in another process.

    Options: ``address`` (``ws://HOST:PORT``), ``protocol``; ``timeout_s`` of a reply,
    ``reconnect_s`` to wait for a server that has ended between episodes, ``horizon``, the actions
    to be played of a chunk, ``images`` (``raw`` or ``png``), and those of `AgentSpec`.
    """
    return RemoteAgent(setup)


def _spec_of(about: Mapping[str, Any], env_id: str) -> AgentSpec:
    """Returns the spec that a server asks for; one for images and language if it asks for none."""
    params = about.get("observation_params")
    served = about.get("env")
    if served is not None and served != env_id:
        raise RemoteError(f"The server serves {shown(served)}, and the run is of {env_id}.")
    if not isinstance(params, dict) or "control_mode" not in params:
        return AgentSpec(
            name="Remote policy",
            control_mode=continuous_control(env_id),
            obs_mode="rgb",
            targets="language",
            instruction="task",
            camera_size_px=IMAGE_SIZE_PX,
        )
    name = about.get("agent")
    spec = AgentSpec(name=f"{name} (remote)", control_mode=str(params["control_mode"]))
    return with_params(spec, params)


def _chunk(actions: Any) -> list[Tensor]:
    """Returns the actions (1, A) of a chunk (C, A), or of a single action (A,)."""
    array = np.asarray(actions) if isinstance(actions, np.ndarray | list) else np.zeros(())
    array = array[None] if array.ndim == 1 else array
    if array.ndim != 2 or not 0 < len(array) <= MOST_ACTIONS or array.dtype.kind not in NUMBERS:
        found = list(array.shape) if isinstance(actions, np.ndarray) else shown(actions)
        raise RemoteError(f"The server's actions are {found}; (C, A) numbers are valid.")
    array = array.astype(np.float32) if array.dtype.kind == "f" else array.astype(np.int64)
    return list(torch.from_numpy(array).split(1))


def _report_of(reply: Mapping[str, Any], seconds: float) -> AgentReport:
    failure, doing = reply.get("failure"), reply.get("doing")
    return AgentReport(
        failure=failure if isinstance(failure, str) else None,
        doing=doing if isinstance(doing, str) else "",
        timings_s={"server": seconds},
    )


def _address(text: str) -> str:
    """Returns a valid address; a token must not be in it, because the address is recorded."""
    with contextlib.suppress(ValueError):
        parts = urlsplit(text)
        plain = not (parts.query or parts.fragment or parts.username)
        if parts.scheme in ("ws", "wss") and parts.hostname and parts.port and plain:
            return text
    raise OptionError.of_value("--option address", text, "ws://HOST:PORT or wss://HOST:PORT")


def _required(options: Mapping[str, str], name: str) -> str:
    if name not in options:
        example = {"protocol": PROTOCOLS[0], "address": "ws://127.0.0.1:8000"}[name]
        raise OptionError(f"hab_eval:remote needs --option {name}=..., e.g. {name}={example}.")
    return options[name]


def _read(options: Mapping[str, str], name: str, default: T, read: Callable[[str, str], T]) -> T:
    return read(f"--option {name}", options[name]) if name in options else default


def _seconds(option: str, text: str) -> float:
    valid = f"a number of seconds from 0 to {LONGEST_S:g}"
    with contextlib.suppress(ValueError):
        if 0 < number(option, float(text), valid) <= LONGEST_S:
            return float(text)
    raise OptionError.of_value(option, text, valid)


def _horizon(option: str, text: str) -> int | None:
    digits = int(text) if text.isdecimal() else text
    return whole(option, digits, 1, MOST_ACTIONS)
