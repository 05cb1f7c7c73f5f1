"""Agents that violate the protocol, each in one way, named by the fault."""

from __future__ import annotations

import signal
import time
from dataclasses import replace

import stub_hab
import torch

from hab_tasks.agent import AgentReport, AgentSetup

REPORTS = {
    "none": None,
    "text": "x",
    "empty": [],
    "two": [AgentReport(), AgentReport()],
    "entry_none": [None],
    "failure_number": [AgentReport(failure=5)],
    "failure_surrogate": [AgentReport(failure="\ud800")],
    "timings_list": [AgentReport(timings_s=[("plan", 1.0)])],
    "timings_key": [AgentReport(timings_s={5: 1.0})],
    "timings_text": [AgentReport(timings_s={"plan": "1"})],
    "timings_negative": [AgentReport(timings_s={"plan": -0.1})],
    "timings_nan": [AgentReport(timings_s={"plan": float("nan")})],
    "timings_huge": [AgentReport(timings_s={"plan": 10**400})],
    "doing_none": [AgentReport(doing=None)],
    "doing_surrogate": [AgentReport(doing="\ud800")],
    "trace_none": [AgentReport(trace=None)],
    "trace_numbers": [AgentReport(trace=(1, 2))],
    "trace_tensor": [AgentReport(trace=({"a": torch.zeros(1)},))],
    "trace_nan": [AgentReport(trace=({"a": float("nan")},))],
}
"""Case -> what `report` returns."""

SPECS = {
    "name_number": {"name": 5},
    "name_blank": {"name": " \n"},
    "name_surrogate": {"name": "\ud800"},
    "control_mode_none": {"control_mode": None},
    "control_mode_empty": {"control_mode": ""},
    "obs_mode_none": {"obs_mode": None},
    "obs_mode_unknown": {"obs_mode": "foo"},
    "obs_mode_plus": {"obs_mode": "rgb+"},
    "privileged_text": {"privileged": "yes"},
    "looks_unknown": {"looks": "sometimes"},
    "target_frame_unknown": {"target_frame": "world"},
    "handle_position_text": {"handle_position": "x"},
    "targets_unknown": {"targets": "words"},
    "instruction_unknown": {"instruction": "step"},
    "cameras_text": {"cameras": "head"},
    "camera_size_px_text": {"camera_size_px": "224"},
    "camera_hfov_rad_none": {"camera_hfov_rad": None},
    "privileged_language": {"privileged": True, "targets": "language"},
    "obs_mode_flat": {"obs_mode": "state", "instruction": "task"},
    "rows_zero": {"rows": 0},
    "rows_true": {"rows": True},
    "rows_text": {"rows": "2"},
}
"""Case -> fields of the spec."""

ACTIONS = {
    "none": None,
    "list": [[0.0, 0.0]],
    "array": torch.zeros(1, 2).numpy(),
    "no_batch": torch.zeros(2),
    "two_rows": torch.zeros(2, 2),
    "no_rows": torch.zeros(0, 2),
    "complex": torch.zeros(1, 2, dtype=torch.complex64),
    "sparse": torch.zeros(1, 2).to_sparse(),
    "meta": torch.zeros(1, 2, device="meta"),
}
"""Case -> what `act` returns."""


class Halved(stub_hab.StubAgent):
    """Its `act` is no method."""

    act = 5


class Guarded(stub_hab.StubAgent):
    """Its spec cannot be read."""

    @property
    def spec(self) -> None:
        raise OSError("no spec today")

    @spec.setter
    def spec(self, value: object) -> None:
        pass


def made(setup: AgentSetup) -> object:
    """Makes the agent that the option `case` names."""
    kind, _, case = setup.options["case"].partition(":")
    agent = stub_hab.StubAgent()
    if kind == "report":
        agent.report = lambda: REPORTS[case]
    elif kind == "spec":
        agent.spec = None if case == "none" else replace(agent.spec, **SPECS[case])
    elif kind == "act":
        agent.act = lambda obs: ACTIONS[case]
    elif kind == "factory":
        return _bad_factory(case)
    elif kind == "late":
        _be_late(agent, case)
    else:
        _raise_in(agent, *case.split(":"))
    return agent


def _bad_factory(case: str) -> object:
    kinds = {"nothing": None, "class": stub_hab.StubAgent, "absent": object(), "halved": Halved()}
    if case == "guarded":
        return Guarded()
    if case in kinds:
        return kinds[case]
    raise _error(case)


def _raise_in(agent: stub_hab.StubAgent, method: str, case: str) -> None:
    """Has a method raise in the second episode."""
    inner = getattr(agent, method)

    def raising(*arguments: object) -> object:
        given = inner(*arguments)
        if agent.seeds[-1] % 1000 == 1:
            raise _error(case)
        return given

    setattr(agent, method, raising)


def _error(case: str) -> BaseException:
    errors = {
        "exit": SystemExit(0),
        "value": ValueError("three\nlines\nof it"),
        "long": RuntimeError("x" * 100_000),
        "stop": StopIteration(),
        "control": RuntimeError("\x1b[31mred\x1b[0m"),
    }
    return errors[case]


def _be_late(agent: stub_hab.StubAgent, case: str) -> None:
    """Has `reset`, or the second `act`, hang in the episodes of seeds 1 and 3."""
    method, _, way = case.partition(":")
    start, inner = agent.reset, getattr(agent, method)

    def reset(mask: object, seeds: list[int]) -> None:
        agent.seen.clear()
        start(mask, seeds)

    agent.reset = reset

    def hanging(*arguments: object) -> object:
        given = inner(*arguments)
        seeds = stub_hab.episode_seeds(arguments[1]) if method == "reset" else agent.seeds
        if seeds[-1] % 1000 in (1, 3) and (method == "reset" or len(agent.seen) > 1):
            if way == "deaf":
                signal.signal(signal.SIGTERM, signal.SIG_IGN)
            time.sleep(1.0 if way == "nap" else 600)
        return given

    setattr(agent, method, hanging)
