"""What is to be calibrated: a case's scenario and measured logs, its parameters, and both simulators for it."""
