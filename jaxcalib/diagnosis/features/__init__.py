"""Diagnostic features of one drive, whoever recorded or simulated it, and their noise."""
