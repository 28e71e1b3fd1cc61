"""SUMO scenarios: read, and written back with other values."""
