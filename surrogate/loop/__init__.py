"""The time loop: decisions, motion, and the state of runs."""
