"""Executors: run independent jobs in worker processes of this machine or of a Ray cluster."""

from hab_tasks.io.executors.choice import ExecutorChoice, open_executor
from hab_tasks.io.executors.executor import Executor, Task

__all__ = ["Executor", "ExecutorChoice", "Task", "open_executor"]
