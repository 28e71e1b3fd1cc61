"""SUMO as an engine: one simulation per worker process."""
