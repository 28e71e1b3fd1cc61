"""How well a calibration finds inflows back, over roads, against what the drives hold about them."""
