"""Validation: a calibrated result against the field, in SUMO alone, by named standards."""
