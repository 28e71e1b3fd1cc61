"""Designs whose columns are balanced: finite fields, the geometry of their columns, which to keep, the arrays."""
