"""Runs of agents on episodes."""
