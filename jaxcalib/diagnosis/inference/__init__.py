"""Which explanation agrees with the field: evidence, contests, refits, verdict."""
