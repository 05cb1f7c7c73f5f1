"""Recurrent PPO and DD-PPO for hab-tasks."""
