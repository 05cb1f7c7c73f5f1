"""Suite memory: memory of one environment process and of each additional one."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from hab_eval.bench.options import BenchOptions
from hab_eval.bench.processes import Vector, VectorEnv
from hab_eval.bench.rows import BenchRow, bound_row, make_row
from hab_eval.bench.suite import TIDY_HOUSE, Suite, WriteLine
from hab_eval.errors import BenchError

FEW, MANY = 1, 3
"""Sizes of the two vector environments."""

PROCESS_BOUND_MB = 700.0
FURTHER_BOUND_MB = 350.0

BYTES_PER_KB, BYTES_PER_MB = 1024, 1e6
"""The kernel reports units of 1024 bytes."""


@dataclass(frozen=True, kw_only=True)
class Memory:
    """Memory of a process [MB].

    Attributes:
        rss_mb: Resident set size; shared pages count fully.
        pss_mb: Proportional set size; pages shared by n processes count 1/n, so sums are valid.
        uss_mb: Unique set size; private pages only, which are freed when the process ends.
    """

    rss_mb: float
    pss_mb: float
    uss_mb: float


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Memory of a vector environment.

    Attributes:
        parent: Memory of the process that steps the environments.
        workers: Memory of each environment's process.
    """

    parent: Memory
    workers: tuple[Memory, ...]

    @property
    def pss_mb(self) -> float:
        """Total memory of all processes."""
        return self.parent.pss_mb + sum(worker.pss_mb for worker in self.workers)


def read_memory(pid: int) -> Memory:
    """Reads the memory of a process; Linux only."""
    file = Path(f"/proc/{pid}/smaps_rollup")
    try:
        return parse_rollup(file.read_text(encoding="ascii"))
    except OSError as error:
        raise BenchError(f"Suite memory needs Linux; {file} cannot be read: {error}.") from error


def parse_rollup(text: str) -> Memory:
    """Parses `smaps_rollup`: a line with addresses, then lines ``Name: number kB``."""
    fields = (line.split() for line in text.splitlines()[1:])
    kb = {words[0].rstrip(":"): int(words[1]) for words in fields}

    def mb(*names: str) -> float:
        return sum(kb[name] for name in names) * BYTES_PER_KB / BYTES_PER_MB

    return Memory(rss_mb=mb("Rss"), pss_mb=mb("Pss"), uss_mb=mb("Private_Clean", "Private_Dirty"))


def run_memory(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures HabTidyHouse-v1 in vector environments of sizes `FEW` and `MANY`, per scene."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:

        def start(count: int, scene: str = scene) -> Vector:
            return VectorEnv(options, TIDY_HOUSE, scene, count)

        readings = measure(options, start, write_line)
        rows += memory_rows(("memory", scene, TIDY_HOUSE), readings)
    return rows


def measure(
    options: BenchOptions, start: Callable[[int], Vector], write_line: WriteLine
) -> list[tuple[Reading, Reading]]:
    """Returns alternating pairs of readings, each from new processes after reset and steps."""
    start(FEW).close()  # warm-up: the parent's imports stay loaded
    pairs = []
    for repeat in range(options.repeats):
        pair = (_reading(options, start, FEW, repeat), _reading(options, start, MANY, repeat))
        pairs.append(pair)
        write_line(
            f"repeat {repeat + 1} of {options.repeats}: resident {pair[0].workers[0].rss_mb:.0f} MB"
            f", each additional process {further_mb(*pair):.0f} MB"
        )
    return pairs


def _reading(
    options: BenchOptions, start: Callable[[int], Vector], count: int, seed: int
) -> Reading:
    with closing(start(count)) as vector:
        vector.run_steps(options.step_count, seed)
        gc.collect()
        workers = tuple(read_memory(pid) for pid in vector.pids())
        return Reading(parent=read_memory(os.getpid()), workers=workers)


def further_mb(few: Reading, many: Reading) -> float:
    """Returns the total memory per additional environment [MB]."""
    return (many.pss_mb - few.pss_mb) / (len(many.workers) - len(few.workers))


def memory_rows(
    name: tuple[str, str, str], pairs: Sequence[tuple[Reading, Reading]]
) -> list[BenchRow]:
    """Returns the rows of readings: one process, and each additional one."""
    one = [few.workers[0] for few, _ in pairs]
    resident = [memory.rss_mb for memory in one]
    private = [sum(w.uss_mb for w in many.workers) / len(many.workers) for _, many in pairs]
    further = [further_mb(few, many) for few, many in pairs]

    def beside(variant: str, values: Sequence[float]) -> BenchRow:
        return make_row((*name, variant), values, resident, unit="MB", reference="one_env_rss")

    def bound(variant: str, values: Sequence[float], bound_mb: float) -> BenchRow:
        return bound_row((*name, variant), values, bound_mb, unit="MB")

    return [
        bound("one_env_rss", resident, PROCESS_BOUND_MB),
        beside("one_env_pss", [memory.pss_mb for memory in one]),
        beside("one_env_uss", [memory.uss_mb for memory in one]),
        bound("further_env_pss", further, FURTHER_BOUND_MB),
        bound("further_env_uss", private, FURTHER_BOUND_MB),
    ]


SUITE = Suite(name="memory", run=run_memory, steps=50)
