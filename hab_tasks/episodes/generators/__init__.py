"""Episode generators: settled, stable and reachable start states."""
