"""Engine of all environments: simulation, episodes, measures, observations and rules."""
