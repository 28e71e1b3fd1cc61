"""Field cases whose unmodelled effect is withheld, made in SUMO by code that shares nothing with the diagnosis."""
