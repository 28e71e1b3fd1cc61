"""Faults put into good logs, one at a time: which are found, and whether the cause is named."""
