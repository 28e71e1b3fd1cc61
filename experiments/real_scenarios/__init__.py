"""How a folder of cases fares: what is accepted, what a calibration gains, and how near the surrogate comes to SUMO."""
