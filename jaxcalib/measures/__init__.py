"""Measures of performance: folds over perception frames, the same code for the field, the surrogate and SUMO."""
