"""Calibrates SUMO traffic around automated vehicles from the logs that such a vehicle recorded."""
