"""How far the surrogate is from SUMO: `python -m experiments.fidelity`."""
