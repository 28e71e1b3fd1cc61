"""Calibration of a problem: objective, evaluation of candidates, stages, confirmation in SUMO."""
