"""Calibrated traffic in the formats of the simulators where vehicles are tested."""
