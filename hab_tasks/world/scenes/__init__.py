"""Scenes: Habitat's dataset format, read into `SceneSpec` and built in the simulator."""
