"""Agents of the stub for workers that do not import the file of the main process, as Ray's."""

from stub_hab import StubAgent, constant, install, many, raising

__all__ = ["StubAgent", "constant", "many", "raising"]

install()
