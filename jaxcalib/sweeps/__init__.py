"""Sweeps: many parameter sets on several seeds each, in either engine, as rows of one table."""
