"""Validation of agents, their actions and their reports; errors name the agent and the field."""

from __future__ import annotations

import contextlib
import json
import math
import os
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, get_args, get_type_hints

import torch
from torch import Tensor

from hab_eval.errors import AgentError
from hab_tasks.agent import Agent, AgentReport, AgentSpec
from hab_tasks.errors import HabError, RunStoppedError, shown
from hab_tasks.typed_values import LARGEST_NUMBER, is_text

OBS_MODES = ("state", "state_dict", "sensor_data", "pointcloud", "none")
OBS_PARTS = ("rgb", "depth", "segmentation", "position", "normal", "albedo")
"""ManiSkill's observation modes, and the parts that can be joined by ``+``, also with a state."""


@contextlib.contextmanager
def loading(what: str) -> Generator[None, None, None]:
    """Converts exceptions of an agent's module or factory into errors that name `what`.

    Raises:
        AgentError: The code raised; the message has the exception and its location.
        RunStoppedError: The code called `sys.exit`.
    """
    try:
        yield
    except HabError:
        raise  # e.g. the factory rejected an option
    except SystemExit as stop:
        raise RunStoppedError(f"{what} called sys.exit({stop.code!r}){_location(stop)}.") from stop
    except Exception as error:
        # The message of a SyntaxError has the location already.
        location = "" if isinstance(error, SyntaxError) else _location(error)
        raise AgentError(f"{what} raised {type(error).__name__}: {error}{location}") from error


@contextlib.contextmanager
def without_exit() -> Generator[None, None, None]:
    """Prevents an agent from ending the process, which would look like the end of the run.

    Raises:
        AgentError: The agent called `sys.exit`.
    """
    try:
        yield
    except SystemExit as stop:
        raise AgentError(f"The agent called sys.exit({stop.code!r}){_location(stop)}.") from stop


def check_agent(agent: object, reference: str) -> Agent:
    """Returns the agent if it follows the `Agent` protocol.

    Raises:
        AgentError: A member is missing, or a field of its spec is invalid.
    """
    if not isinstance(agent, Agent) or not all(
        callable(getattr(agent, name)) for name in ("reset", "act", "report")
    ):
        raise AgentError(
            f"{reference} returned a {type(agent).__name__}, which is not a hab_tasks.agent.Agent: "
            "it needs spec, reset, act and report."
        )
    if not isinstance(agent.spec, AgentSpec):
        raise AgentError(
            f"{reference}: spec is {shown(agent.spec)}; it must be a hab_tasks.agent.AgentSpec."
        )
    check_spec(agent.spec, reference)
    return agent


def check_rows(spec: AgentSpec) -> None:
    """Checks the batch size of an agent.

    Raises:
        AgentError: It is not a positive integer.
    """
    if isinstance(spec.rows, bool) or not isinstance(spec.rows, int) or spec.rows < 1:
        raise AgentError(f"rows of the agent must be an integer >= 1, got {spec.rows!r}.")


def check_actions(actions: object, count: int) -> Tensor:
    """Returns an agent's actions (N, A) on the CPU, without gradient.

    The environment checks the values.

    Raises:
        AgentError: They are not a real, dense tensor of N rows.
    """
    if not isinstance(actions, Tensor) or actions.ndim != 2 or actions.shape[0] != count:
        found = tuple(actions.shape) if isinstance(actions, Tensor) else type(actions).__name__
        raise AgentError(f"act() must return a ({count}, A) tensor for {count} rows, got {found}.")
    if actions.is_complex():
        raise AgentError(f"act() must return a real tensor, got {actions.dtype}.")
    if actions.layout is not torch.strided or actions.is_meta or actions.is_quantized:
        found = "a tensor without data" if actions.is_meta else f"{actions.layout}, {actions.dtype}"
        raise AgentError(f"act() must return a dense tensor, got {found}.")
    return actions.detach().cpu()


def check_reports(reports: object, count: int, name: str) -> Sequence[AgentReport]:
    """Returns one `AgentReport` per row, after checking types and `doing`.

    Args:
        reports: Return value of `Agent.report`.
        count: Number of rows.
        name: Name of the agent, for errors.

    Raises:
        AgentError: The value is not a list of `count` valid reports.
    """
    if not isinstance(reports, Sequence) or len(reports) != count:
        found = len(reports) if isinstance(reports, Sequence) else shown(reports)
        raise AgentError(f"{name}: report() must return a list of {count} reports, got {found}.")
    for report in reports:
        if not isinstance(report, AgentReport):
            found = type(report).__name__
            raise AgentError(f"{name}: report() must return AgentReport objects, got a {found}.")
        if not isinstance(report.doing, str) or not is_text(report.doing):
            raise _bad_report(name, "doing", report.doing, "text")
    return reports


def check_report(report: AgentReport, name: str) -> tuple[str | None, dict[str, float]]:
    """Returns the failure and the durations [s] of a report, ready to be written.

    Args:
        report: The report at the end of an episode.
        name: Name of the agent, for errors.

    Raises:
        AgentError: A field is invalid; the message names it and its valid values.
    """
    failure = report.failure
    if failure is not None and not (isinstance(failure, str) and is_text(failure)):
        raise _bad_report(name, "failure", failure, "None or text")
    if not isinstance(report.timings_s, Mapping):
        raise _bad_report(name, "timings_s", report.timings_s, "a dict of name -> seconds")
    timings_s = {}
    for key, value in report.timings_s.items():
        if not isinstance(key, str) or not is_text(key):
            raise _bad_report(name, "a name in timings_s", key, "text")
        timings_s[key] = _seconds(value)
        if timings_s[key] is None:
            raise _bad_report(name, f"timings_s[{shown(key)}]", value, "a finite number >= 0")
    _check_trace(report.trace, name)
    return failure if failure and failure.strip() else None, timings_s


def check_spec(spec: AgentSpec, reference: str) -> None:
    """Checks the fields of a spec.

    Raises:
        AgentError: One is invalid; the message names it and its valid values.
    """
    hints = get_type_hints(AgentSpec)
    for field in fields(AgentSpec):
        value, hint = getattr(spec, field.name), hints[field.name]
        choices: Iterable[object] = get_args(hint)
        if field.name in TUPLES:
            is_valid, valid = TUPLES[field.name]
            if is_valid(value):
                continue
        elif choices and value not in choices:
            valid = " or ".join(repr(choice) for choice in choices)
        elif not choices and field.name != "rows" and type(value) is not hint:
            valid = f"of type {hint.__name__}"
        elif isinstance(value, str) and not (value.strip() and is_text(value)):
            valid = "non-blank text"
        elif field.name == "obs_mode" and not _is_obs_mode(value):
            valid = f"one of {', '.join(OBS_MODES)}, or some of {', '.join(OBS_PARTS)} joined by +"
        else:
            continue
        raise AgentError(f"{reference}: spec.{field.name} is {shown(value)}; it must be {valid}.")
    if spec.targets == "language" and spec.privileged:
        raise AgentError(f"{reference}: spec.privileged is true; it must be false for language.")
    if spec.instruction is not None and not _has_groups(spec.obs_mode):
        valid = "one with groups for an instruction, e.g. 'state_dict' or 'rgb'"
        raise AgentError(
            f"{reference}: spec.obs_mode is {shown(spec.obs_mode)}; it must be {valid}."
        )
    check_rows(spec)


def _has_groups(obs_mode: str) -> bool:
    """Returns whether observations are dicts."""
    return obs_mode not in ("state", "none")


def _are_files(value: object) -> bool:
    return isinstance(value, tuple) and all(_is_file(path) for path in value)


def _are_names(value: object) -> bool:
    return value is None or (
        isinstance(value, tuple) and all(isinstance(name, str) and is_text(name) for name in value)
    )


TUPLES: dict[str, tuple[Callable[[object], bool], str]] = {
    "files": (_are_files, "a tuple of paths of files"),
    "cameras": (_are_names, "None or a tuple of names of cameras"),
}
"""Field -> its check, and what is valid."""


def _is_file(path: object) -> bool:
    return isinstance(path, str) and os.path.isfile(path)


def _is_obs_mode(mode: str) -> bool:
    joined = {*OBS_PARTS, "state", "state_dict", "pointcloud", "none"}
    return mode in OBS_MODES or set(mode.split("+")) <= joined


def _check_trace(trace: object, name: str) -> None:
    if not isinstance(trace, Sequence) or not all(isinstance(entry, Mapping) for entry in trace):
        raise _bad_report(name, "trace", trace, "a tuple of dicts")
    try:
        json.dumps(trace, allow_nan=False, ensure_ascii=False).encode("utf-8")
    except (TypeError, ValueError, RecursionError) as error:
        raise AgentError(f"{name}: trace in report() is not JSON-serializable: {error}.") from error


def _seconds(value: Any) -> float | None:
    """Returns a duration, also of NumPy or torch, as a float; None if it is invalid."""
    if isinstance(value, (str, bytes)):
        return None
    try:
        seconds = float(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        return None
    return seconds if math.isfinite(seconds) and 0 <= seconds <= LARGEST_NUMBER else None


def _bad_report(name: str, field: str, value: object, valid: str) -> AgentError:
    return AgentError(f"{name}: {field} in report() is {shown(value)}; it must be {valid}.")


def _location(error: BaseException) -> str:
    """Returns the file and line at which an error was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    return f" ({frames[-1].filename}, line {frames[-1].lineno})" if frames else ""
