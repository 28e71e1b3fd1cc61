"""How fast the simulators are; ratios within one run, since machines differ and are noisy."""
