"""How dangerous calibrated traffic is, against that of the true parameters."""
