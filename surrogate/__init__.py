"""Traffic physics in JAX: a multi-lane road with ramps. Knows nothing of SUMO, of field data or of calibration."""
