"""Least squares: response surfaces and steps on them, and Levenberg-Marquardt for many problems side by side."""
