"""From a scenario and a parameter vector to the surrogate's world."""
